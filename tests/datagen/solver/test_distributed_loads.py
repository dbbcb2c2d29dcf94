r"""Distributed loads act on all points of every element: patch tests, Lamé's sphere, a column.

A patch test has a load under which a body of any cells takes a state that its elements contain.
Pressures follow the surface; their derivative is that of differences.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from mpi4py import MPI
from numpy.typing import NDArray
from scipy.integrate import quad as integral
from scipy.optimize import brentq, fsolve

from datagen.discretisation.element import Element
from datagen.mesh.distributed_mesh import distributed, make_mesh
from datagen.mesh.geometries import Box
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import SolverSettings
from shared_schema.actuators import pressed
from shared_schema.common.bodies.cells import outward_facets
from shared_schema.common.bodies.command_loads import CommandLoads, LoadedBody, command_loads
from shared_schema.common.bodies.distributed_loads import (
    area_vectors,
    facet_derivatives,
    pressure_forces,
)
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.bodies.points_between import PointsBetween
from shared_schema.materials import NeoHookean
from tests.datagen.solver.cantilever import box
from tests.datagen.solver.manufactured import bent_box

Array = NDArray[np.float64]
ELEMENTS: tuple[Element, ...] = ("linear", "quadratic", "incompressible")
E, NU = 1000.0, 0.3  # Pa
MU, LAMBDA = E / 2 / (1 + NU), E * NU / (1 + NU) / (1 - 2 * NU)
MATERIAL = NeoHookean(young_modulus=E, poisson_ratio=NU, volumetric="quadratic")
SETTINGS = SolverSettings(relative_tolerance=1e-13, linear_solver="lu")
FACETS = {  # corners of one facet in space or in the plane
    "edge": np.array([[0.0, 0.1], [1.0, 0.4]]),
    "triangle": np.array([[0.0, 0.0, 0.1], [1.0, 0.2, 0.0], [0.1, 0.9, 0.3]]),
    "quadrilateral": np.array([[0, 0, 0.1], [1, 0.2, 0], [1.1, 0.9, 0.3], [0, 1, 0.0]]),
}


def has_points_between(element: Element, simplices: bool) -> bool:
    return element == "quadratic" or (element == "incompressible" and simplices)


def solved(
    raw: RawMesh,
    element: Element,
    held: NDArray[np.bool_],
    *loads: str,
    body_force: tuple[float, ...] | None = None,
    material: NeoHookean = MATERIAL,
) -> tuple[Array, EquilibriumProblem, CommandLoads]:
    """Displacement (n_nodes, d) in m under loads as of the command line."""
    x, mesh = raw.coordinates, distributed(raw, MPI.COMM_SELF)
    points = None
    if has_points_between(element, raw.cell_type in ("triangle", "tetra")):
        points = PointsBetween.of(raw.cells, raw.cell_type, len(x))
    sides = {f"{'xyz'[i]}=1": np.isclose(x[:, i], 1.0) for i in range(x.shape[1])}
    if raw.node_sets:
        sides = dict(raw.node_sets)
    body = LoadedBody(x, raw.cells, raw.cell_type, held, sides, points)
    given = command_loads(body, loads, body_force=body_force, needed=False)
    problem = EquilibriumProblem(mesh, material, held, SETTINGS, element, following=given.following)
    load = np.arange(len(x)), given.forces
    pressures, between = pressed(given.pressures), given.forces_between
    report = solve_load_case(problem, *load, SETTINGS, pressures, between=between)
    assert report.solved, report.explanation
    return problem.displacement(), problem, given


def slides(x: Array) -> NDArray[np.bool_]:
    """Component i is held on the side x_i = 0."""
    return np.isclose(x, 0.0)


def stress(stretch: Array) -> Array:
    """First Piola stress of `MATERIAL` by the principal stretches, (3,) in Pa."""
    j = np.prod(stretch)
    return np.asarray(MU * (stretch - 1 / stretch) + LAMBDA * (j - 1) * j / stretch)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("simplices", [False, True], ids=["bricks", "simplices"])
@pytest.mark.parametrize("element", ELEMENTS)
def test_patch_under_traction(element: Element, simplices: bool, d: int) -> None:
    """A pull of 300 Pa: the stretches of a bar, one along it and one across, of `stress`."""
    raw = bent_box(d, 2, simplices)
    pull = "x=1:300,0" + ",0" * (d - 2)
    u, problem, given = solved(raw, element, slides(raw.coordinates), pull)

    def wrong(s: Array) -> list[float]:
        p = stress(np.array([s[0], s[1], s[1] if d == 3 else 1.0]))
        return [p[0] - 300, p[1]]

    along, across = fsolve(wrong, [1.2, 0.9], xtol=1e-14)
    expected = raw.coordinates * (np.array([along, across, across]) - 1)[:d]
    assert along > 1.2
    assert np.abs(u - expected).max() < 1e-9
    reactions = problem.reactions()
    assert reactions.sum(axis=0) == pytest.approx(-given.at_rest.sum(axis=0), abs=1e-8)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("simplices", [False, True], ids=["bricks", "simplices"])
@pytest.mark.parametrize("element", ELEMENTS)
def test_patch_under_pressure(element: Element, simplices: bool, d: int) -> None:
    """A pressure of 300 Pa that follows: P = -p J / λ, with one stretch in all directions."""
    raw = bent_box(d, 2, simplices)
    sides = [f"{axis}=1:300" for axis in "xyz"[:d]]
    u, problem, _ = solved(raw, element, slides(raw.coordinates), *sides)

    def wrong(s: float) -> float:
        stretch = np.array([s, s, s if d == 3 else 1.0])
        return float(stress(stretch)[0] + 300 * np.prod(stretch) / s)

    s = brentq(wrong, 0.5, 1.0, xtol=1e-15)
    assert s < 0.9
    assert np.abs(u - (s - 1) * raw.coordinates).max() < 1e-9
    pushed = 300 * s ** (d - 1)  # on each side
    assert problem.reactions().sum(axis=0) == pytest.approx([pushed] * d, rel=1e-9)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(
    ("element", "simplices"),
    [
        *(("linear", False), ("quadratic", False), ("quadratic", True)),
        *(("incompressible", False), ("incompressible", True)),
    ],
)
def test_patch_under_body_force(element: Element, simplices: bool, d: int) -> None:
    r"""A layer that is held at y = 0 and sheared by its weight: :math:`u_x = b/μ (y - y^2/2)`.

    J = 1, P_xy = P_yx = μ u_x' and all other components of P vanish, so that u_x'' = -b/μ for loads
    of any size. Quadratic elements contain this state in any mesh. Bricks of linear elements take
    its values at the nodes of a regular mesh. Triangles and tetrahedra of linear elements do not.
    Pressures in incompressible ones are linear, and miss those of second order, μ u_x'^2 / d: at
    1e-5 m, they are rounding errors of the part that changes its sign with b.
    """
    quadratic = has_points_between(element, simplices)
    raw = bent_box(d, 2, simplices) if quadratic else box((1.0,) * d, (2,) * d, simplices)
    x = raw.coordinates
    held = np.zeros(x.shape, dtype=bool)
    held[np.isclose(x[:, 1], 0.0)] = True
    held[:, 1] |= np.isclose(x[:, 0], 0.0) | np.isclose(x[:, 0], 1.0)
    if d == 3:
        held[:, 2] |= np.isclose(x[:, 2], 0.0) | np.isclose(x[:, 2], 1.0)
    small = element == "incompressible" and simplices
    b = (1e-5 if small else 1.0) * MU

    def under(force: float) -> Array:
        return solved(raw, element, held, body_force=(force, *[0.0] * (d - 1)))[0]

    u = (under(b) - under(-b)) / 2 if small else under(b)
    expected = np.zeros(x.shape)
    expected[:, 0] = b / MU * (x[:, 1] - x[:, 1] ** 2 / 2)
    assert np.abs(u - expected).max() < 1e-9 * np.abs(expected).max()


def shell(n: int, simplices: bool) -> RawMesh:
    """An eighth of a hollow sphere of 1 m and 2 m, of 3 n³ hexahedra or 6 tetrahedra in each.

    Three patches of directions (1, s, t), (t, 1, s) and (s, t, 1), from 0 to 1.
    """
    steps = np.linspace(0, 1, n + 1)
    s, t, r = (each.ravel() for each in np.meshgrid(steps, steps, 1 + steps, indexing="ij"))
    places = []
    for turn in range(3):
        way = np.roll(np.column_stack([np.ones_like(s), s, t]), turn, axis=1)
        places.append(r[:, None] * way / np.linalg.norm(way, axis=1, keepdims=True))
    number = np.arange(len(s)).reshape((n + 1,) * 3)
    corner = {
        (i, j, k): number[i : i + n, j : j + n, k : k + n].ravel()
        for i, j, k in np.ndindex(2, 2, 2)
    }
    if simplices:
        ways = [
            np.cumsum([np.zeros(3, int), *order], axis=0)
            for order in permutations(np.eye(3, dtype=int))
        ]
        cells = np.concatenate(
            [np.stack([corner[tuple(at)] for at in way], axis=1) for way in ways]
        )
    else:
        square = [(0, 0), (1, 0), (1, 1), (0, 1)]
        cells = np.stack([corner[i, j, k] for k in (0, 1) for i, j in square], axis=1)
    x, first, of = np.unique(
        np.round(np.concatenate(places), 10), axis=0, return_index=True, return_inverse=True
    )
    x = np.concatenate(places)[first]
    cells = np.concatenate([of.ravel()[cells + turn * len(s)] for turn in range(3)])
    inside = np.isclose(np.linalg.norm(x, axis=1), 1.0)
    x[np.isclose(x, 0.0)] = 0.0
    return RawMesh(x, cells, "tetra" if simplices else "hexahedron", {"inside": inside})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("element", "simplices"),
    [("quadratic", False), ("quadratic", True), ("incompressible", True)],
)
def test_thick_sphere(element: Element, simplices: bool) -> None:
    r"""Lamé's displacement of the inner surface, which the error of flat facets approaches as h².

    .. math:: u(a) = \frac{p \, a^3}{E \, (b^3 - a^3)}
        \left( (1 - 2ν) \, a + (1 + ν) \frac{b^3}{2 a^2} \right)
    """
    p = 1e-5 * E
    expected = p / E / 7 * ((1 - 2 * NU) + (1 + NU) * 4)
    errors = []
    for n in (2, 4):
        raw = shell(n, simplices)
        u, _, _ = solved(raw, element, slides(raw.coordinates), f"inside:{p}")
        outwards = (u * raw.coordinates).sum(axis=1)[raw.node_sets["inside"]]
        errors.append(abs(outwards.mean() / expected - 1))
    assert errors[1] < 0.03, errors
    assert errors[0] / errors[1] > 3, errors


@pytest.mark.parametrize("simplices", [False, True], ids=["bricks", "simplices"])
@pytest.mark.parametrize("element", ELEMENTS)
def test_column_under_its_weight(element: Element, simplices: bool) -> None:
    r"""A column of 1 m with ν = 0 that hangs: μ (λ - 1/λ) = b (1 - y), and u = ∫ (λ - 1) dy.

    The error at its end falls as h² with linear elements, and as h⁴ with quadratic bricks; with
    triangles, whose quadrature is not exact for the energy, nearly as h³.
    """
    material = NeoHookean(young_modulus=E, poisson_ratio=0.0, volumetric="quadratic")
    b, mu = 500.0, E / 2

    def strain(y: float) -> float:
        p = b * (1 - y) / mu
        return float((p + np.sqrt(p**2 + 4)) / 2 - 1)

    expected = integral(strain, 0, 1, epsabs=1e-14)[0]
    errors = []
    for n in (1, 2):
        raw = box((0.5, 1.0), (n, 2 * n), simplices)
        x = raw.coordinates
        held = np.isclose(x, 0.0)
        u, _, _ = solved(raw, element, held, body_force=(0.0, b), material=material)
        end = u[np.isclose(x[:, 1], 1.0), 1]
        errors.append(abs(end.mean() / expected - 1))
    quadratic = has_points_between(element, simplices)
    order = (2.5 if simplices else 3.9) if quadratic else 1.9
    assert np.log2(errors[0] / errors[1]) > order, errors
    assert errors[1] < (5e-5 if quadratic else 3e-3), errors


@pytest.mark.parametrize("kind", sorted(FACETS))
def test_derivative(kind: str) -> None:
    """Central differences of the nodal forces of one facet, entry by entry."""
    positions = FACETS[kind]
    facets = np.arange(len(positions))[None]
    found = facet_derivatives(positions, facets, 3.0)[0]
    h, expected = 1e-6, np.empty_like(found)
    for column, (node, axis) in enumerate(np.ndindex(positions.shape)):
        change = np.zeros_like(positions)
        change[node, axis] = h
        upward = pressure_forces(positions + change, facets, 3.0)
        downward = pressure_forces(positions - change, facets, 3.0)
        expected[:, column] = ((upward - downward) / (2 * h)).ravel()
    assert found == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("elements", [(3, 2), (3, 2, 2)])
def test_closed_surface_has_no_resultant(elements: tuple[int, ...]) -> None:
    """∮ n dS = 0 and ∮ x · n dS = d V, whatever the direction in which cells are numbered."""
    upper = (2.0, 1.0, 1.5)[: len(elements)]
    mesh = make_mesh(Box(lower=(0,) * len(elements), upper=upper, elements=elements), MPI.COMM_SELF)
    cells = mesh.cells.copy()
    turned = [0, 3, 2, 1] if len(elements) == 2 else [4, 5, 6, 7, 0, 1, 2, 3]
    cells[::2] = cells[::2][:, turned]
    facets = outward_facets(mesh.coordinates, cells, mesh.cell_type)
    areas = area_vectors(mesh.coordinates, facets)
    assert areas.sum(axis=0) == pytest.approx(0, abs=1e-12)
    volume = (areas * mesh.coordinates).sum()
    assert volume == pytest.approx(len(elements) * np.prod(upper), rel=1e-12)
