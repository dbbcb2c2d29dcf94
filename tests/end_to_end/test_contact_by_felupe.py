"""The factory's contact, held against another program: FElupe's rigid cylinder and plane.

FElupe (https://felupe.readthedocs.io) penalises the depth of nodes in the tool, and the slip of
those that stick, so that its error falls as the inverse of the penalty; two of them give the limit.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import felupe
import numpy as np
from numpy.typing import NDArray
from tensortrax.math import log, sqrt, trace
from tensortrax.math.linalg import det

import surrogate
from tests.end_to_end.commands import DATAGEN, execute

YOUNG_MODULUS, POISSON_RATIO = 500.0, 0.4
Array = NDArray[np.float64]
Contact = Callable[..., Any]  # FElupe's contact, with its penalty to be said


class Body(NamedTuple):
    """Nodes, quadrilaterals, and nodes that are held and that can be touched."""

    coordinates: Array
    cells: NDArray[np.int64]
    clamped: NDArray[np.bool_]
    surface: NDArray[np.int64]


def paper_energy(c: Any, mu: float, lam: float) -> Any:
    """ψ = μ/2 (tr C − 3 − 2 ln J) + λ/4 (J² − 1 − 2 ln J)."""
    j = sqrt(det(c))
    return mu / 2 * (trace(c) - 3 - 2 * log(j)) + lam / 4 * (j**2 - 1 - 2 * log(j))


def by_felupe(body: Body, contact: Contact, way: Array, penalty: float) -> tuple[Array, Array]:
    """Displacement, (n_nodes, 2) in m, and force of the tool in N, (2,).

    The tool goes over the points of a way, (n_steps + 1, 2).
    """
    count = len(body.coordinates)
    points = np.vstack([body.coordinates, way[0]])
    mesh = felupe.Mesh(points, body.cells.astype(int), "quad")
    mesh.points_without_cells = mesh.points_without_cells[:0]
    plane = felupe.FieldPlaneStrain(felupe.RegionQuad(mesh), dim=2)
    field = felupe.FieldContainer([plane])
    mu = YOUNG_MODULUS / 2 / (1 + POISSON_RATIO)
    lam = 2 * mu * POISSON_RATIO / (1 - 2 * POISSON_RATIO)
    solid = felupe.SolidBody(felupe.Hyperelastic(paper_energy, mu=mu, lam=lam), field)
    tool = contact(
        field,
        points=body.surface,
        centerpoint=count,
        items=[solid],
        multiplier=penalty,
        multiplier_tangential=penalty,
    )
    centre = np.arange(count + 1) == count
    axes = [felupe.Boundary(plane, mask=centre, skip=skip) for skip in ((0, 1), (1, 0))]
    held = felupe.Boundary(plane, mask=np.append(body.clamped, False))
    boundaries = {"clamped": held, "x": axes[0], "y": axes[1]}
    ramp = dict(zip(axes, (way - way[0]).T, strict=True))
    step = felupe.Step([solid, tool], boundaries=boundaries, ramp=ramp)
    felupe.Job([step]).evaluate(verbose=0, tol=1e-9)
    internal = solid.assemble.vector(field).toarray().reshape(-1, 2)[:count]
    return plane.values[:count].copy(), internal[~body.clamped].sum(axis=0)


def assert_limit(
    found: Any, body: Body, contact: Contact, way: Array, penalties: tuple[int, int], rtol: float
) -> None:
    """Displacement and resultant of a file are those of the limit of two penalties."""
    soft, stiff = (by_felupe(body, contact, way, penalty) for penalty in penalties)
    displacement, reaction = (2 * b - a for a, b in zip(soft, stiff, strict=True))
    largest = float(np.abs(displacement).max())
    assert largest > 0.09
    np.testing.assert_allclose(found["displacement"], displacement, atol=rtol * largest)
    size = float(np.linalg.norm(reaction))
    np.testing.assert_allclose(found["force"].sum(axis=0), reaction, atol=rtol * size)


def test_disc_on_the_beam(tmp_path: Path) -> None:
    """It comes down from above the upper face."""
    out, end, radius = tmp_path / "pushed.npz", np.array([3.0, 1.2]), 0.3
    execute(DATAGEN, "solve", "beam2d", "--tool", f"sphere:3,1.2:{radius}", "--out", out)
    geometry = surrogate.load("beam2d_any").geometry
    surface = np.setdiff1d(geometry.surface_nodes, np.flatnonzero(geometry.clamped))
    body = Body(geometry.coordinates, geometry.cells, geometry.clamped, surface)

    def disc(*of: Any, **rest: Any) -> Any:
        return felupe.ContactRigidCylinder(*of, radius=radius, **rest)

    way = np.linspace(end + np.array([0, 0.11]), end, 13)
    with np.load(out) as found:
        assert_limit(found, body, disc, way, penalties=(2, 4), rtol=1e-4)


def test_plane_that_rubs(tmp_path: Path) -> None:
    """It presses a block by 0.1 m, then moves by 0.05 m along: some nodes stick, others slip.

    As many steps of the same length as here: 20.
    """
    out, friction, cells = tmp_path / "rubbed.npz", 0.3, 6
    words = ["--set", "mesh.upper=[1,1]", "--set", f"mesh.elements=[{cells},{cells}]"]
    words += ["--set", "load.region={x: 1}", "--tool", "plane:0.9,0:-1,0"]
    words += ["--friction", str(friction), "--tool-from=0.15,-0.05", "--tool-from=0,-0.05"]
    execute(DATAGEN, "solve", "beam2d", *words, "--out", out)
    with np.load(out) as file:
        found = dict(file)
    x = found["coordinates"]
    number = {tuple(place): node for node, place in enumerate(np.rint(cells * x).astype(int))}
    quads = [
        [number[i, j], number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]]
        for i in range(cells)
        for j in range(cells)
    ]
    surface = np.flatnonzero(((x == 0) | (x == 1)).any(axis=1) & (x[:, 0] > 0))
    body = Body(x, np.array(quads), x[:, 0] == 0, surface)

    def plane(*of: Any, **rest: Any) -> Any:
        return felupe.ContactRigidPlane(*of, normal=[-1, 0], friction=friction, **rest)

    begin, via, end = np.array([[1.05, -0.05], [0.9, -0.05], [0.9, 0.0]])
    way = np.vstack([np.linspace(begin, via, 16), np.linspace(via, end, 6)[1:]])
    assert_limit(found, body, plane, way, penalties=(16, 32), rtol=2e-4)
    pushed = found["force"][found["force"].any(axis=1)]
    slips = np.isclose(np.abs(pushed[:, 1]), -friction * pushed[:, 0], rtol=1e-6)
    assert 0 < slips.sum() < len(slips)
