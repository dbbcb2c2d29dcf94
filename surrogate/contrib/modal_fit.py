"""The cubature of an equilibrium in modes, fitted to predictions of a reduced network."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import InputError
from surrogate.learning.inference.calibration import loads_of
from surrogate.learning.inference.modal_cubature import equilibrium_of, modes_of
from surrogate.learning.networks.reduced_network import ReducedNetwork
from surrogate.mechanics.modal_equilibrium import Cubature, fit_cubature
from surrogate.mechanics.solids.solid import Solid
from surrogate.runtime.tensor_file import serialised

if TYPE_CHECKING:
    from surrogate.learning.inference.surrogate import Surrogate

POINTS, LOADS = 200, 150
CANDIDATES = 6000  # quadrature points that a cubature chooses from, at most
EQUATIONS = 12  # of the fit, of every point
Array = NDArray[np.float64]


@checked_arguments
def fit_balance(
    surrogate: Surrogate, points: int = POINTS, loads: int = LOADS, seed: int = 0
) -> Cubature:
    """Fit a cubature to states that a reduced network predicts under random loads of its training.

    Parameters
    ----------
    surrogate : Surrogate
    points : int
        Number of quadrature points, at most.
    loads : int
        Number of random loads.
    seed : int
        Of loads, candidates and equations.

    Raises
    ------
    InputError
        If a number is below 1, or the network has no equilibrium in modes (`require_balance`).
    """
    require_balance(surrogate)
    for name, value in (("points", points), ("loads", loads)):
        if value < 1:
            raise InputError(f"--{name} {value}: expected 1 at least")
    solid, modes, rng = surrogate.body.equilibrium.solid, modes_of(surrogate), _random(seed)
    volumes = solid.volumes.numpy()
    per_cell = volumes.shape[1]
    count = min(volumes.size, CANDIDATES)
    chosen = np.sort(rng.choice(volumes.size, count, replace=False))
    every = Cubature(*np.divmod(chosen, per_cell), volumes.ravel()[chosen])
    every = every._replace(weights=every.weights * volumes.sum() / every.weights.sum())
    body = equilibrium_of(surrogate, modes, every)
    family = loads_of(surrogate)
    columns, totals, flat = [], [], modes.reshape(len(modes), -1)
    each = max(1, EQUATIONS * points // loads)
    for _ in range(loads):
        force, coefficients = _predicted(surrogate, family.draw(1, rng))
        a = body.linear(force) + coefficients
        u = torch.from_numpy((a @ flat).reshape(1, *modes.shape[1:]))
        if not torch.isfinite(solid.energy(u)).all():
            continue
        tangent = body.tangent(a)
        values, vectors = np.linalg.eigh(tangent)
        compliance = vectors / np.maximum(np.abs(values), 1e-6 * values.max()) @ vectors.T
        equations = rng.normal(size=(each, len(a))) @ compliance / np.sqrt(each)
        of_points = body.forces_of_points(a)
        columns.append(equations @ of_points)
        totals.append(equations @ (flat @ solid.internal_forces(u)[0].numpy().ravel()))
    size = float(np.sqrt(np.mean([np.square(total).sum() for total in totals])))
    columns.append(every.weights[None] * size / volumes.sum())
    totals.append(np.array([size]))
    kept, factors = fit_cubature(np.concatenate(columns), np.concatenate(totals), points)
    return Cubature(every.cells[kept], every.points[kept], factors * every.weights[kept])


def require_balance(surrogate: Surrogate) -> None:
    """Raise InputError unless a network has an equilibrium in modes."""
    network, run = surrogate.network.network, surrogate.description.run
    if not isinstance(network, ReducedNetwork) or surrogate.is_probabilistic or network.members > 1:
        raise InputError(
            f"'{run.name}': expected a single deterministic reduced network, found {run.title}, "
            f"{run.likelihood.replace('_', ' ')}, {surrogate.network.members} of them"
        )
    if run.displacement_scale != "global":
        raise InputError(
            f"'{run.name}': key 'displacement_scale' = {run.displacement_scale}, expected global"
        )
    solid = surrogate.body.equilibrium.solid
    if type(solid) is not Solid:
        raise InputError("elements: expected standard ones, whose volumes change at every point")
    if solid.fibres is not None:
        raise InputError("material: expected one without fibres")
    if surrogate.geometry.shapes is not None:
        raise InputError(f"'{run.name}': expected a body of one shape")


def cubature_file(cubature: Cubature) -> bytes:
    """Content of a file of a cubature."""
    return serialised({k: torch.from_numpy(v) for k, v in cubature._asdict().items()})


@torch.inference_mode()
def _predicted(surrogate: Surrogate, forces: Array) -> tuple[Array, Array]:
    """Forces g in J and the network's coefficients under one load, (1, n_nodes, d): (m,), (m,)."""
    field = surrogate.network
    network = field.network
    assert isinstance(network, ReducedNetwork)
    given = torch.from_numpy(forces).float().to(field.free.device)
    grid = surrogate.predictor.network.on_grid(given)
    scaled = grid / field.force_scale
    unit = field.force_scale * field.displacement_scale.flatten()[0]
    work = scaled.flatten(2)[:, :, network.points].flatten(1) @ network.modes.T * unit
    found = work, network.coefficients(scaled)
    force, coefficients = (each[0].double().cpu().numpy() for each in found)
    return force, coefficients


def _random(seed: int) -> np.random.Generator:
    if seed < 0:
        raise InputError(f"seed {seed}: expected 0 or more", "seed")
    return np.random.default_rng(seed)
