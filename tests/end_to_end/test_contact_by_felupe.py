"""The factory's contact, held against another program: FElupe's rigid cylinder in the plane.

FElupe (https://felupe.readthedocs.io) penalises the depth of nodes in the cylinder, so that its
error falls as the inverse of the penalty; two of them give the limit.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import felupe
import numpy as np
from numpy.typing import NDArray
from tensortrax.math import log, sqrt, trace
from tensortrax.math.linalg import det

import surrogate
from tests.end_to_end.commands import DATAGEN, execute

X, BEGIN, END, RADIUS = 3.0, 1.31, 1.2, 0.3  # m: the disc comes down from above the upper face
STEPS, PENALTIES = 12, (2, 4)
YOUNG_MODULUS, POISSON_RATIO = 500.0, 0.4
Array = NDArray[np.float64]


def paper_energy(c: Any, mu: float, lam: float) -> Any:
    """ψ = μ/2 (tr C − 3 − 2 ln J) + λ/4 (J² − 1 − 2 ln J)."""
    j = sqrt(det(c))
    return mu / 2 * (trace(c) - 3 - 2 * log(j)) + lam / 4 * (j**2 - 1 - 2 * log(j))


def by_felupe(penalty: float) -> tuple[Array, Array]:
    """Displacement of the beam, (n_nodes, 2) in m, and the force of the disc on it in N."""
    body = surrogate.load("beam2d_any").geometry
    count, clamped = len(body.coordinates), np.flatnonzero(body.clamped)
    points = np.vstack([body.coordinates, [X, BEGIN]])
    mesh = felupe.Mesh(points, body.cells.astype(int), "quad")
    mesh.points_without_cells = mesh.points_without_cells[:0]
    plane = felupe.FieldPlaneStrain(felupe.RegionQuad(mesh), dim=2)
    field = felupe.FieldContainer([plane])
    mu = YOUNG_MODULUS / 2 / (1 + POISSON_RATIO)
    lam = 2 * mu * POISSON_RATIO / (1 - 2 * POISSON_RATIO)
    solid = felupe.SolidBody(felupe.Hyperelastic(paper_energy, mu=mu, lam=lam), field)
    contact = felupe.ContactRigidCylinder(
        field,
        points=np.setdiff1d(body.surface_nodes, clamped),
        centerpoint=count,
        radius=RADIUS,
        items=[solid],
        multiplier=penalty,
    )
    centre = np.arange(count + 1) == count
    held = np.append(body.clamped, False)
    move = felupe.Boundary(plane, mask=centre, skip=(1, 0))
    boundaries = {
        "clamped": felupe.Boundary(plane, mask=held),
        "held": felupe.Boundary(plane, mask=centre, skip=(0, 1)),
        "move": move,
    }
    way = felupe.math.linsteps([0, END - BEGIN], num=STEPS)
    step = felupe.Step([solid, contact], boundaries=boundaries, ramp={move: way})
    felupe.Job([step]).evaluate(verbose=0, tol=1e-9)
    internal = solid.assemble.vector(field).toarray().reshape(-1, 2)[:count]
    return plane.values[:count].copy(), internal[~body.clamped].sum(axis=0)


def test_disc_on_the_beam(tmp_path: Path) -> None:
    out = tmp_path / "pushed.npz"
    execute(DATAGEN, "solve", "beam2d", "--tool", f"sphere:{X},{END}:{RADIUS}", "--out", out)
    soft, stiff = (by_felupe(penalty) for penalty in PENALTIES)
    displacement, reaction = (2 * b - a for a, b in zip(soft, stiff, strict=True))
    with np.load(out) as found:
        largest = float(np.abs(displacement).max())
        assert largest > 0.1
        np.testing.assert_allclose(found["displacement"], displacement, atol=1e-4 * largest)
        size = float(np.linalg.norm(reaction))
        np.testing.assert_allclose(found["force"].sum(axis=0), reaction, atol=1e-4 * size)
