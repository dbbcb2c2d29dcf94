"""Step: samples per second of the plain loop and of ours, and the memory that they take.

The plain loop leaves PyTorch's settings as they are, so that its convolutions use TF32.
"""

from __future__ import annotations

from typing import Any

import torch

from surrogate.data.dataset import Dataset
from surrogate.models.unet_model import UNetModel
from tests.benchmarks.training_throughput import (
    Epoch,
    configuration,
    our_epochs,
    plain_epochs,
    seconds,
)
from tests.gpu.setting import Results, Setting
from tests.gpu.trainings import changed

NETWORKS = {  # configuration, dataset, changes of the network
    "paper": ("beam2d-det-paper", "beam2d", {}),
    "fast": ("beam2d-det-fast", "beam2d", {}),
    "3D, c = 64": ("beam3d-det-paper", "beam3d", {"channels": 64, "multiplier": 1}),
}
BATCHES = (4, 32, 256)
SAMPLES = {4: 400, 32: 1600, 256: 5120}
LARGEST_IN_SPACE = 32
ROUNDS = 3
WAYS: dict[str, dict[str, Any]] = {
    "float32, eager": {"precision": "float32"},
    "float32, graphs": {"precision": "float32", "cuda_graphs": True},
    "TF32, graphs": {"precision": "tensorfloat32", "cuda_graphs": True},
    "bfloat16, graphs": {"precision": "bfloat16", "cuda_graphs": True},
    "TF32, compiled, graphs": {
        "precision": "tensorfloat32",
        "cuda_graphs": True,
        "compile": True,
    },
}


def throughput(setting: Setting) -> Results:
    """Time all networks and batches; those for which there is no time are left out."""
    found: list[Results] = []
    for name, (recipe, case, shape) in NETWORKS.items():
        dataset = setting.dataset(case)
        for batch in BATCHES[:1] if setting.small else BATCHES:
            if dataset.geometry.dimension == 3 and batch > LARGEST_IN_SPACE:
                continue
            plain = None
            for way, changes in {"plain": {}, **WAYS}.items():
                if "compile" in changes and (setting.small or batch > BATCHES[0]):
                    continue
                if setting.seconds_left < (30 if "compile" in changes else 4):
                    return {"training": found, "complete": False}
                config = small_or_whole(
                    setting, configuration(recipe, case, {**changes, "batch_size": batch}), shape
                )
                result = timed(setting, config, dataset, plain=way == "plain")
                plain = plain or result["samples_per_second"]
                ratio = round(result["samples_per_second"] / plain, 3)
                found.append({"network": name, "way": way, **result, "ratio": ratio})
    return {"training": found, "complete": True}


def small_or_whole(setting: Setting, config: UNetModel, shape: dict[str, Any]) -> UNetModel:
    """Return a configuration with another shape; of four channels in a rehearsal."""
    training = {} if setting.on_gpu else {"cuda_graphs": False}
    return changed(config, {**shape, **({"channels": 4} if setting.small else {})}, training)


def timed(setting: Setting, config: UNetModel, dataset: Dataset, plain: bool) -> Results:
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
