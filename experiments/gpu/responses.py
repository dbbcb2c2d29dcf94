"""Step: the networks of the package on the device, for batches of 1 to 4096 loads.

Predictions, fast bounds of them and a few directions take NumPy arrays and return such. Load series
have data-dependent loops, which no CUDA graph holds; what a load takes is therefore launches, and a
batch shares them. The CPU of the same machine is the reference, for the results and for the time.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from experiments.benchmarks.one_load import loads
from experiments.framework.experiment import Findings
from experiments.framework.timing import Timing, median_seconds
from experiments.gpu.setting import GpuSetting, Results
from experiments.measures.latency import Work
from surrogate import Surrogate, load
from surrogate.inference import fixed_directions

NETWORKS = ("beam2d_any", "lshape2d_any", "beam3d_any", "beam3d_any_reduced")
BATCHES, IN_SPACE = (1, 64, 512, 4096), (1, 64, 512)
DIRECTIONS = 4
ON_CPU = 64  # loads of the largest batch that the CPU is timed with
COMPARED = 8  # loads
Array = NDArray[np.float64]


def responses(setting: GpuSetting) -> Findings:
    """Time all networks; those for which there is no time are left out."""
    found: list[Results] = []
    for name in NETWORKS:
        model, reference = load(name, setting.device.type), load(name)
        sizes = BATCHES if model.geometry.dimension == 2 else IN_SPACE
        for batch in sizes[: 4 - model.geometry.dimension] if setting.small else sizes:
            if setting.seconds_left < 6:
                return Findings(numbers={"responses": found, "complete": False})
            found.append({"name": name, **of_batch(setting, model, reference, batch)})
    return Findings(numbers={"responses": found, "complete": True})


def of_batch(setting: GpuSetting, model: Surrogate, reference: Surrogate, batch: int) -> Results:
    """Times in ms of one batch, and the differences between the devices."""
    forces = loads(model, "few", batch)
    predicted, expected = model.predict(forces), reference.predict(forces[:COMPARED])
    size = np.abs(expected).max(axis=(1, 2))
    difference = np.abs(predicted[:COMPARED] - expected).max(axis=(1, 2)) / size
    result: Results = {"batch": batch, "relative_difference": float(np.median(difference))}
    result["predict_ms"] = milliseconds(setting, lambda: model.predict(forces))
    if batch <= ON_CPU:
        result["cpu_ms"] = milliseconds(setting, lambda: reference.predict(forces))
    bounds = model.bounds(forces, predicted)
    of_cpu = reference.bounds(forces[:COMPARED], predicted[:COMPARED])
    known = np.isfinite(of_cpu.largest)
    ratio = np.abs(bounds.largest[:COMPARED][known] / of_cpu.largest[known] - 1)
    result["bounds_relative_difference"] = float(np.median(ratio)) if known.any() else None
    result["bounds_ms"] = milliseconds(setting, lambda: model.bounds(forces, predicted))
    with torch.inference_mode():
        drive = fixed_directions(model, DIRECTIONS).to(setting.device)
        given = [torch.from_numpy(field).to(setting.device) for field in (forces, predicted)]

        def directed() -> Array:
            return np.asarray(drive(*given)[0].cpu())

        result["directions"] = DIRECTIONS
        result["directions_ms"] = milliseconds(setting, directed)
    return result


def milliseconds(setting: GpuSetting, work: Work) -> float:
    """Median wall time in ms."""
    timing = Timing(repeats=1 if setting.small else 50, seconds=0.3)
    return round(1e3 * median_seconds(work, timing), 4)
