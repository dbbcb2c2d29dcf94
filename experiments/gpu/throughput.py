"""Step: samples per second of the plain loop and of ours, and the memory that they take.

The plain loop leaves PyTorch's settings as they are, so that its convolutions use TF32.
"""

from __future__ import annotations

from typing import Any

import torch

from experiments.benchmarks.training import (
    Epoch,
    configuration,
    our_epochs,
    plain_epochs,
    seconds,
)
from experiments.framework.experiment import Findings
from experiments.gpu.setting import GpuSetting, Results
from experiments.measures.untrained import changed
from surrogate import Dataset
from surrogate.learning.models import UNetModel

NETWORKS = {  # configuration, dataset, changes of the network
    "paper": ("beam2d-det-paper", "beam2d", {}),
    "fast": ("beam2d-det-fast", "beam2d", {}),
    "3D, c = 64": ("beam3d-det-paper", "beam3d", {"channels": 64, "multiplier": 1}),
}
BATCHES = (4, 32, 256)
SAMPLES = {4: 400, 32: 1600, 256: 5120}
LARGEST_IN_SPACE = 32
ROUNDS = 3
PLAIN, COMPILED = "plain", "TF32, compiled, graphs"
COMPILING = 30.0  # s that compiling one network may take
WAYS: dict[str, dict[str, Any]] = {
    PLAIN: {},
    "float32, eager": {"precision": "float32"},
    "float32, graphs": {"precision": "float32", "cuda_graphs": True},
    "TF32, graphs": {"precision": "tensorfloat32", "cuda_graphs": True},
    "bfloat16, graphs": {"precision": "bfloat16", "cuda_graphs": True},
    COMPILED: {"precision": "tensorfloat32", "cuda_graphs": True, "compile": True},
}


def throughput(setting: GpuSetting) -> Findings:
    """Time all networks and batches, compiled ones last; without time, the rest is left out."""
    found: list[Results] = []
    datasets = {case: setting.dataset(case) for _, case, _ in NETWORKS.values()}
    plain: dict[tuple[str, int], float] = {}
    for name, batch, way in combinations(setting):
        recipe, case, shape = NETWORKS[name]
        if setting.seconds_left < (COMPILING if way == COMPILED else 4):
            return Findings(numbers={"training": found, "complete": False})
        changes = {**WAYS[way], "batch_size": batch}
        config = small_or_whole(setting, configuration(recipe, case, changes), shape)
        result = timed(setting, config, datasets[case], way == PLAIN)
        rate = result["samples_per_second"]
        ratio = round(rate / plain.setdefault((name, batch), rate), 3)
        found.append({"network": name, "way": way, **result, "ratio": ratio})
    return Findings(numbers={"training": found, "complete": True})


def combinations(setting: GpuSetting) -> list[tuple[str, int, str]]:
    """Networks, batches and ways in order; the plain loop is the first of its network and batch."""
    result = [
        (name, batch, way)
        for name, (_, case, _) in NETWORKS.items()
        for batch in (BATCHES[:1] if setting.small else BATCHES)
        if batch <= LARGEST_IN_SPACE or not case.endswith("3d")
        for way in WAYS
        if way != COMPILED
    ]
    if not setting.small:
        result += [(name, BATCHES[0], COMPILED) for name in NETWORKS]
    return result


def small_or_whole(setting: GpuSetting, config: UNetModel, shape: dict[str, Any]) -> UNetModel:
    """Return a configuration with another shape; of four channels in a rehearsal."""
    training = {} if setting.on_gpu else {"cuda_graphs": False}
    return changed(config, {**shape, **({"channels": 4} if setting.small else {})}, training)


def timed(setting: GpuSetting, config: UNetModel, dataset: Dataset, plain: bool) -> Results:
    """Time the epochs of one way, after one that warms up."""
    batch = config.training.batch_size
    samples = dataset.train[: 8 if setting.small else SAMPLES[batch]]
    if setting.on_gpu:
        torch.cuda.empty_cache()
        torch.cuda.reset_peak_memory_stats(setting.device)
    make = plain_epochs if plain else our_epochs
    epoch: Epoch = make(config, dataset, samples, setting.device)
    first = seconds(epoch, setting.device)
    rounds = [seconds(epoch, setting.device) for _ in range(1 if setting.small else ROUNDS)]
    memory = torch.cuda.max_memory_allocated(setting.device) if setting.on_gpu else None
    return {
        "batch": batch,
        "samples": len(samples),
        "first_epoch_s": round(first, 4),
        "rounds_s": [round(time, 5) for time in rounds],
        "samples_per_second": round(len(samples) / min(rounds), 2),
        "peak_memory_bytes": memory,
    }
