"""Command calibrate: fast bounds of a trained network on fresh loads of its case."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common import Commands, InputError, add_command

if TYPE_CHECKING:
    import surrogate
    from surrogate.certify import FastCertificate
    from surrogate.inference import HeldOut

LEVEL = 0.95
Array = NDArray[np.float64]


def add_to(commands: Commands) -> None:
    """Add the parser."""
    parser = add_command(
        commands,
        "calibrate",
        "calibrate the fast bounds of a network on corrected loads of its case, without its "
        "dataset",
        "python -m experiments calibrate surrogate/trained/beam3d_any --loads 400",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of the run, which is changed")
    parser.add_argument("--loads", type=int, default=400, help="that are calibrated on")
    parser.add_argument("--fresh", type=int, default=100, help="others, which are measured")
    parser.add_argument("--seed", type=int, default=41)
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Calibrate, measure, and write both into the run."""
    import surrogate
    from surrogate.inference import HeldOut, fit_on_samples

    model, count = surrogate.load(options.run), options.loads
    forces = random_loads_of_case(model, count + options.fresh, options.seed)
    samples = HeldOut.corrected(model, forces[:count], 1, 0)
    fast = fit_on_samples(model, samples)
    fresh = HeldOut.corrected(model, forces[count:], 1, 0)
    found = {
        **measured(fast, model, fresh, options.fresh),
        "calibration": f"{count} loads of the case, seed {options.seed}, {len(samples.force)} "
        "predicted stable and corrected",
        "measured_on": f"the next {options.fresh}, {len(fresh.force)} predicted stable and "
        "corrected",
    }
    content = model.run.read_evaluation() | {"fast_certificate": found}
    text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
    files = {model.run.evaluation: text.encode(), model.run.fast_certificate: fast.serialised()}
    for path, data in files.items():
        path.unlink(missing_ok=True)
        path.write_bytes(data)
    model.run.seal.add(files)
    print(json.dumps(found, indent=1))


def random_loads_of_case(model: surrogate.Surrogate, count: int, seed: int) -> Array:
    """Draw nodal forces in N from the load families of a network's case, (count, n_nodes, d).

    Raises
    ------
    InputError
        If the case has another family than random nodes of a symmetric range, and pressures.
    """
    from surrogate.data import random_loads
    from surrogate.mechanics import FollowerPressure

    body, rng = model.geometry, np.random.default_rng(seed)
    forces = np.zeros((count, *body.coordinates.shape))
    pressures = np.zeros((count, len(body.surfaces)))
    load = model.description.data.case["load"]
    for force, pressure in zip(forces, pressures, strict=True):
        pushed = []
        for family in load if isinstance(load, list) else [load]:
            name, (low, high) = family["family"], family["range"]
            if name == "pressure":
                pushed.append(rng.uniform(low, high))
            elif name == "random_nodes" and low == -high:
                limit, (fewest, most) = (high,) * force.shape[1], family["count"]
                force += random_loads("trained", body, limit, (fewest, most)).draw(1, rng)[0]
            else:
                raise InputError(
                    f"load family '{name}', range {low} to {high}: expected random_nodes of a "
                    "symmetric range, and pressure"
                )
        pressure[:] = pushed
    if body.surfaces:
        pressed = FollowerPressure(body.coordinates, body.surfaces, pressures)
        forces += np.where(body.held, 0, pressed.at_rest)
    return forces


def measured(
    fast: FastCertificate, model: surrogate.Surrogate, fresh: HeldOut, loads: int
) -> dict[str, Any]:
    """Measure the bounds on fresh samples; those of `loads` that are not among them are refused."""
    from surrogate.inference import separated
    from surrogate.measures import node_errors

    dead, pressure = separated(model.geometry, fresh.force)
    predicted = fresh.predicted.mean
    content = fast.measures(dead, predicted, fresh.truth, None, pressure)
    bounds = fast.certify(dead, predicted, LEVEL, None, pressure)
    bounded = np.isfinite(bounds.largest)
    content["refused"] = 1 - int(bounded.sum()) / loads
    exceeded = {
        "mean": np.abs(predicted - fresh.truth).mean((1, 2)) > bounds.mean,
        "largest": node_errors(predicted, fresh.truth).max(1) > bounds.largest,
    }
    content["bounded"] = {
        "level": LEVEL,
        "loads": loads,
        "bounded": int(bounded.sum()),
        "exceeded": {name: int(more.sum()) for name, more in exceeded.items()},
    }
    return content
