"""Step: the networks of the package on the device, for batches of 1 to 4096 loads.

Predictions, fast bounds of them and a few directions take NumPy arrays and return such. Load series
have data-dependent loops, which no CUDA graph holds; what a load takes is therefore launches, and a
batch shares them. `python -m experiments gpu pack` writes what the CPU computes for some loads
(`REFERENCES`).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from experiments.framework.experiment import Findings
from experiments.gpu.setting import GpuSetting, Results
from surrogate import Surrogate, load
from surrogate.learning.inference import fixed_directions

NETWORKS = ("beam2d_any", "lshape2d_any", "beam3d_any", "beam3d_any_reduced")
BATCHES, IN_SPACE = (1, 64, 512, 4096), (1, 64, 512)
DIRECTIONS = 4
COMPARED, FEW = 8, 4  # loads; nodes of a load
REFERENCES = "references.npz"
LAST = 6.0  # s that a batch may take
Array = NDArray[np.float64]


def responses(setting: GpuSetting) -> Findings:
    """Time all networks; those for which there is no time are left out."""
    found: list[Results] = []
    with np.load(setting.data.parent / REFERENCES) as stored:
        references = {name: stored[name] for name in stored.files}
    for name in NETWORKS:
        model = load(name, setting.device.type)
        expected = references[f"{name}/displacement"], references[f"{name}/bound"]
        sizes = BATCHES if model.geometry.dimension == 2 else IN_SPACE
        for batch in sizes[: 4 - model.geometry.dimension] if setting.small else sizes:
            if setting.seconds_left < LAST:
                return Findings(numbers={"responses": found, "complete": False})
            found.append({"name": name, **of_batch(setting, model, batch, *expected)})
            print(found[-1])
    return Findings(numbers={"responses": found, "complete": True})


def loads(model: Surrogate, count: int) -> Array:
    """Random loads on 1 to 4 nodes: (count, n_nodes, d) in N."""
    random, geometry = np.random.default_rng(0), model.geometry
    limit = np.array(model.description.data.info.force.max_abs)
    nodes = np.flatnonzero(geometry.loadable & ~geometry.held.any(axis=1))
    forces = np.zeros((count, *geometry.coordinates.shape))
    for force in forces:
        some = random.integers(1, FEW + 1)
        chosen = random.choice(nodes, some, replace=False)
        force[chosen] = random.uniform(-limit, limit, (some, len(limit))) / np.sqrt(some)
    return forces


def write_references(path: Path) -> None:
    """Write displacements and bounds in m of a few loads, by the CPU."""
    arrays: dict[str, Array] = {}
    for name in NETWORKS:
        model = load(name)
        forces = loads(model, COMPARED)
        arrays[f"{name}/displacement"] = displacement = model.predict(forces)
        arrays[f"{name}/bound"] = model.bounds(forces, displacement).largest
    np.savez_compressed(path, allow_pickle=False, **arrays)


def of_batch(
    setting: GpuSetting, model: Surrogate, batch: int, expected: Array, bound: Array
) -> Results:
    """Times in ms of one batch, and the differences of its first loads from the CPU's."""
    forces, few = loads(model, max(batch, COMPARED))[:batch], min(batch, COMPARED)
    predicted, expected, bound = model.predict(forces), expected[:few], bound[:few]
    difference = np.abs(predicted[:few] - expected).max((1, 2)) / np.abs(expected).max((1, 2))
    result: Results = {"batch": batch, "relative_difference": float(np.median(difference))}
    result["predict_ms"] = setting.milliseconds(lambda: model.predict(forces), 50, 0.3)
    bounds = model.bounds(forces[:few], expected).largest
    known = np.isfinite(bound)
    ratio = np.abs(bounds[known] / bound[known] - 1)
    result["bounds_relative_difference"] = float(np.median(ratio)) if known.any() else None
    result["bounds_ms"] = setting.milliseconds(lambda: model.bounds(forces, predicted), 50, 0.3)
    with torch.inference_mode():
        drive = fixed_directions(model, DIRECTIONS).to(setting.device)
        given = [torch.from_numpy(field).to(setting.device) for field in (forces, predicted)]

        def directed() -> Array:
            return np.asarray(drive(*given)[0].cpu())

        result["directions"] = DIRECTIONS
        result["directions_ms"] = setting.milliseconds(directed, 50, 0.3)
    return result
