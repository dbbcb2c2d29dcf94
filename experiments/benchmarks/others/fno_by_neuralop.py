"""A Fourier neural operator by neuraloperator (https://github.com/neuraloperator/neuraloperator).

    python fno_by_neuralop.py GIVEN.npz FOUND.npz

GIVEN has ``inputs``, (N, c, nx, ny), and ``outputs``, (N, d, nx, ny), of training samples,
``asked``, (M, c, nx, ny), and the number of ``epochs``; FOUND gets ``outputs``, (M, d, nx, ny), the
number of ``parameters``, and the ``seconds`` of the training.
"""

from __future__ import annotations

import sys
import time

import numpy as np
import torch
from neuralop.models import FNO

torch.manual_seed(0)
with np.load(sys.argv[1]) as given:
    x, y, asked = (torch.from_numpy(given[name]).float() for name in ("inputs", "outputs", "asked"))
    epochs = int(given["epochs"])
x_scale, y_scale = x.std(dim=(0, 2, 3), keepdim=True), y.std(dim=0, keepdim=True).clamp_min(1e-9)
modes = tuple(n // 2 for n in x.shape[2:])
network = FNO(modes, in_channels=x.shape[1], out_channels=y.shape[1], hidden_channels=32)
optimiser = torch.optim.AdamW(network.parameters(), lr=3e-3, weight_decay=1e-5)
batches = len(x) // 32
schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 3e-3, total_steps=epochs * batches)
began = time.perf_counter()
for _ in range(epochs):
    for rows in torch.randperm(len(x))[: 32 * batches].chunk(batches):
        optimiser.zero_grad()
        error = y_scale * network(x[rows] / x_scale) - y[rows]
        error.abs().mean().div(y.abs().mean()).backward()
        optimiser.step()
        schedule.step()
seconds = time.perf_counter() - began
with torch.no_grad():
    outputs = y_scale * network(asked / x_scale)
count = sum(values.numel() for values in network.parameters())
np.savez(sys.argv[2], outputs=outputs.numpy(), parameters=count, seconds=seconds)
