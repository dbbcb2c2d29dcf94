"""Step: frames a second of carried runs, one load after the other: prediction and fast bound.

`python -m experiments gpu pack --runs RUN …` puts the runs and the prediction of one load by the
CPU beside the datasets (`REFERENCE`).
"""

from __future__ import annotations

import tarfile
import tempfile
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from experiments.framework.experiment import Findings
from experiments.framework.timing import timed
from experiments.gpu.setting import GpuSetting, Results
from surrogate import load
from surrogate.learning.inference import drawn_loads
from surrogate.mechanics import BlockSolve, Compliance

REFERENCE, PACKED = "reference.npz", ".tar.xz"
SIZES = (0.5, 0.7, 0.9, 1.0)  # of the load, in turn
SEED = 0
Array = NDArray[np.float64]


def frames(setting: GpuSetting) -> Findings:
    """Time the runs that are there; those for which there is no time are left out."""
    found: list[Results] = []
    for packed in sorted((setting.data.parent / "runs").glob(f"*{PACKED}")):
        if setting.seconds_left < 10:
            return Findings(numbers={"frames": found, "complete": False})
        name = packed.name.removesuffix(PACKED)
        with tempfile.TemporaryDirectory() as folder:
            unpack(packed, Path(folder))
            found.append({"run": name, **of_run(setting, Path(folder))})
            print(found[-1])
    return Findings(numbers={"frames": found, "complete": True})


def unpack(packed: Path, folder: Path) -> None:
    """Write the files of a packed run into a folder."""
    with tarfile.open(packed) as tar:
        for member in tar:
            content = tar.extractfile(member)
            assert content is not None
            (folder / Path(member.name).name).write_bytes(content.read())


def write_reference(run: Path, folder: Path) -> None:
    """Write load and prediction of a run by the CPU, and its estimated error, into a folder."""
    model = load(run)
    force = drawn_loads(model, 1, np.random.default_rng(SEED))[0]
    displacement = model.predict(force)
    error = model.fast_estimate(force[None], displacement[None])[0]
    fields = {"force": force, "displacement": displacement, "error": error}
    np.savez_compressed(folder / REFERENCE, allow_pickle=False, **fields)


def of_run(setting: GpuSetting, folder: Path) -> Results:
    """Times of one run."""
    if setting.on_gpu:
        torch.cuda.empty_cache()
        torch.cuda.reset_peak_memory_stats(setting.device)
    model, seconds = timed(lambda: load(folder, setting.device.type))
    result: Results = {"nodes": len(model.geometry.coordinates), "load_s": round(seconds, 2)}
    with np.load(folder / REFERENCE) as stored:
        force, expected, error = (stored[name] for name in stored.files)
    predicted, seconds = timed(lambda: model.predict(force))
    result["first_prediction_s"] = round(seconds, 2)
    found, seconds = timed(lambda: model.fast_estimate(force[None], expected[None])[0])
    result["first_estimate_s"] = round(seconds, 2)
    for name, one, other in (("", predicted, expected), ("estimate_", found, error)):
        largest = np.abs(one - other).max() / np.abs(other).max()
        result[f"{name}relative_difference"] = float(largest)
    for module in model.network.modules():
        if isinstance(module, Compliance) and (blocks := module.blocks_on(setting.device)):
            result |= of_solver(setting, blocks)
    calibrated = model.run.fast_certificate.is_file()
    number = iter(range(10**9))

    def predict() -> Array:
        return model.predict(force * SIZES[next(number) % len(SIZES)])

    def with_bound() -> None:
        f = force * SIZES[next(number) % len(SIZES)]
        u = model.predict(f)
        if calibrated:
            model.bounds(f, u)
        else:
            model.fast_estimate.with_stability(f[None], u[None])

    result["calibrated"] = calibrated
    result["predict_ms"] = setting.milliseconds(predict, seconds=2.0)
    result["with_bound_ms"] = setting.milliseconds(with_bound, seconds=2.0)
    result["frames_per_second"] = round(1e3 / result["with_bound_ms"], 1)
    if setting.on_gpu:
        result["peak_memory_bytes"] = torch.cuda.max_memory_allocated(setting.device)
    return result


def of_solver(setting: GpuSetting, blocks: BlockSolve) -> Results:
    """Blocks of the stiffness, and the time of one solution in ms."""
    ends = [*blocks.starts[1:], len(blocks.dofs)]
    right = torch.zeros(len(blocks.dofs), 1, dtype=torch.float64, device=setting.device)

    def solve() -> None:
        blocks.solve(right)
        setting.wait()

    return {
        "degrees_of_freedom": len(blocks.dofs),
        "blocks": len(blocks.starts),
        "rows_of_a_block": ends[0],
        "refinements": blocks.refinements,
        "solve_ms": setting.milliseconds(solve, seconds=2.0),
    }
