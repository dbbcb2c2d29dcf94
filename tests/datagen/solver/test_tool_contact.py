r"""Rigid tools: distances, a flat punch in closed form, action and reaction, Coulomb friction.

A rigid sphere on a half space: Hertz's force of small depths.

.. math:: F = \tfrac43 \frac{E}{1 - ν^2} \sqrt R \, δ^{3/2}

(Johnson 1985, *Contact Mechanics*, chapter 4). A quarter of a block, 130 times as wide as the
contact, stands for the half space; its hexahedra grow from the contact on.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import brentq

from datagen import solve
from datagen.command_line import main
from datagen.mesh.distributed_mesh import distributed, make_mesh
from datagen.mesh.geometries import Box
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import SolverSettings
from datagen.solver.tool_contact import Way, touched
from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.errors import InputError, WorkError
from shared_schema.materials import NeoHookean
from shared_schema.tools import Capsule, Mesh, Plane, Sphere, Tool, parse_tool
from tests.closed_surfaces import ball, surface_file
from tests.datagen.farm_runs import datagen, finish
from tests.datagen.refusal import refusal
from tests.datagen.solver.cantilever import box

MATERIAL = NeoHookean(young_modulus=500, poisson_ratio=0.4)
TOOLS = [
    Plane((0.3, 0.1), (1.0, -2.0)),
    Plane((0.3, 0.1, 0.2), (0.0, 0.5, -2.0)),
    Sphere((0.2, -0.1), 0.4),
    Sphere((0.2, -0.1, 0.3), 0.4),
    Capsule((0.0, 0.1), (0.5, 0.4), 0.2),
    Capsule((0.0, 0.1, 0.2), (0.5, 0.4, -0.1), 0.2),
]
RADIUS, DEPTH, YOUNG, POISSON = 20.0, 0.01, 1000.0, 0.3  # m and Pa; the contact's radius is 0.45 m
SIZE, FIRST, EQUAL, CELLS = 60.0, 0.12, 4, 15  # m; equal cells of the first size, and all
DISC = "sphere:3,1.2:0.3"


@pytest.mark.parametrize("tool", TOOLS, ids=lambda tool: f"{type(tool).__name__}{tool.dimension}")
def test_derivatives_of_distances(tool: Tool) -> None:
    """Central differences, |∇g| = 1, and points at a distance g along the normal on the surface."""
    x, h = np.random.default_rng(0).uniform(-1, 1, (200, tool.dimension)), 1e-6
    normal, curvature = tool.normal(x), tool.curvature(x)
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1)
    assert tool.gap(x - tool.gap(x)[:, None] * normal) == pytest.approx(0, abs=1e-12)
    for axis, step in enumerate(h * np.eye(tool.dimension)):
        slope = (tool.gap(x + step) - tool.gap(x - step)) / (2 * h)
        assert normal[:, axis] == pytest.approx(slope, abs=1e-8)
        change = (tool.normal(x + step) - tool.normal(x - step)) / (2 * h)
        smooth = np.abs(change).max(axis=1) < 1e3  # not where a segment ends
        assert curvature[smooth, :, axis] == pytest.approx(change[smooth], abs=1e-4)


def pressed_box(
    d: int, depth: float, tool: Tool | None = None
) -> tuple[EquilibriumProblem, np.ndarray]:
    """A unit box on rollers under a plane that has gone down by a depth; forces of the plane."""
    mesh = make_mesh(Box(lower=(0,) * d, upper=(1,) * d, elements=(3, 2, 2)[:d]), MPI.COMM_SELF)
    settings = SolverSettings()
    problem = EquilibriumProblem(mesh, MATERIAL, mesh.coordinates == 0, settings)
    top, down = np.eye(d)[-1] * (1 - depth), -np.eye(d)[-1]
    tool = tool or Plane(tuple(top), tuple(down))
    surface = np.unique(boundary_facets(mesh.cells, mesh.cell_type))
    problem.load.contact = touched(problem, tool, surface)
    report = solve_load_case(problem, np.empty(0, dtype=np.int64), np.empty((0, d)), settings)
    assert report.solved
    found = problem.load.contact.found(problem.displacement())
    assert found.penetration < 1e-9
    return problem, found.force


def test_factors_where_iterations_fail() -> None:
    """A plane against 25 nodes: inexact Newton steps do not converge, those by LU do."""
    mesh = make_mesh(Box(lower=(0,) * 3, upper=(3, 1, 1), elements=(4, 4, 4)), MPI.COMM_SELF)
    fixed = np.repeat(mesh.coordinates[:, :1] == 0, 3, axis=1)
    surface = np.unique(boundary_facets(mesh.cells, mesh.cell_type))
    totals = []
    for solver in ("lu", "multigrid"):
        settings = SolverSettings(linear_solver=solver)
        problem = EquilibriumProblem(mesh, MATERIAL, fixed, settings)
        problem.load.contact = touched(problem, Plane((2.9, 0, 0), (-1, 0, 0)), surface)
        nothing = np.empty(0, dtype=np.int64), np.empty((0, 3))
        report = solve_load_case(problem, *nothing, settings)
        assert report.solved
        found = problem.load.contact.found(problem.displacement())
        assert found.nodes == 25
        totals.append(found.reaction)
    assert totals[1] == pytest.approx(totals[0], abs=1e-7)


@pytest.mark.parametrize("d", [2, 3])
def test_flat_punch(d: int) -> None:
    r"""A homogeneous state with stretches a across and b = 0.7 along, as the patch test wants.

    P = μ F + (λ/2 (J² − 1) − μ) F⁻ᵀ vanishes across; every node bears its share of the area.
    """
    b, lam, mu = 0.7, MATERIAL.lame_lambda, MATERIAL.lame_mu

    def stress(a: float, along: float) -> float:
        j = b * a ** (d - 1)
        return float(mu * along + (lam / 2 * (j**2 - 1) - mu) / along)

    a = brentq(lambda a: stress(a, a), 0.9, 1.5, xtol=1e-14)
    problem, forces = pressed_box(d, 1 - b)
    x = problem.mesh.coordinates
    stretches = np.array([a] * (d - 1) + [b])
    assert problem.displacement() == pytest.approx(x * (stretches - 1), abs=1e-9)
    top = x[:, -1] == 1
    shares = np.ones(len(x))
    for axis, count in enumerate((3, 2)[: d - 1]):
        at_end = np.isin(x[:, axis], (0, 1))
        shares *= np.where(at_end, 0.5, 1.0) / count
    assert forces[top, -1] == pytest.approx(shares[top] * stress(a, b), rel=1e-6)
    assert np.abs(forces[~top]).max() == 0
    assert np.abs(forces[:, :-1]).max() == 0


def test_flat_face_of_a_surface_is_a_plane(tmp_path: Path) -> None:
    """A cube of 3 m, as a file of triangles that are rounded by 0.02 m, above the unit box."""
    path = surface_file(tmp_path / "cube.stl")
    cube = Mesh(path, (-1.0, -1.0, 0.82), scale=3.0, rounding=0.02)
    of_cube, forces = pressed_box(3, 0.2, cube)
    of_plane, expected = pressed_box(3, 0.2)
    assert of_cube.displacement() == pytest.approx(of_plane.displacement(), abs=1e-9)
    assert forces == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


def test_ball_of_triangles_is_a_sphere(tmp_path: Path) -> None:
    path = surface_file(tmp_path / "ball.stl", *ball(3000))
    of = Mesh(path, (3.0, 0.5, 1.2), scale=0.29, rounding=0.01), Sphere((3.0, 0.5, 1.2), 0.3)
    coarse = ["mesh.elements=[16, 4, 4]"]
    found, expected = (solve("beam3d", tool=tool, changes=coarse).contact for tool in of)
    assert found is not None
    assert expected is not None
    assert found.nodes == expected.nodes
    assert found.penetration < 1e-9
    size = float(np.linalg.norm(expected.reaction))
    assert found.reaction == pytest.approx(expected.reaction, abs=0.03 * size)


@pytest.mark.parametrize(
    ("case", "tool"),
    [("beam2d", "capsule:2.5,1.3:3.5,1.15:0.2"), ("lshape2d", "sphere:5,-0.5:0.7")],
)
def test_action_and_reaction(case: str, tool: str) -> None:
    """Nothing is inside the tool, forces push out of it where there is no gap, and balance."""
    solution = solve(case, tool=tool)
    contact, form = solution.contact, parse_tool(tool, 2)
    assert contact is not None
    x = solution.coordinates + solution.displacement
    pushed = contact.force.any(axis=1)
    assert 0 < pushed.sum() == contact.nodes
    assert form.gap(x).min() == pytest.approx(-contact.penetration, abs=1e-12)
    assert form.gap(x[pushed]) == pytest.approx(0, abs=1e-9)
    along = (contact.force[pushed] * form.normal(x[pushed])).sum(axis=1)
    assert along == pytest.approx(np.linalg.norm(contact.force[pushed], axis=1))
    assert contact.force.sum(0) == pytest.approx(-solution.reactions.sum(0), rel=1e-7)
    as_load = solve(case, contact.force)  # its forces do what it does
    assert as_load.displacement == pytest.approx(solution.displacement, abs=1e-7)
    assert solution.force == pytest.approx(contact.force)


def test_a_tool_beside_the_body_does_nothing() -> None:
    solution = solve("beam2d", "4,1:0,0.2", tool="sphere:2,3:0.5")
    assert solution.contact is not None
    assert solution.contact.nodes == 0
    alone = solve("beam2d", "4,1:0,0.2")
    assert solution.displacement == pytest.approx(alone.displacement, abs=1e-9)


@pytest.mark.parametrize(
    ("tool", "message"),
    [
        ("ball:1,2:3", "expected one of sphere:X,Y[,Z]:R"),
        ("sphere:1,2", "expected one of sphere:X,Y[,Z]:R"),
        ("sphere:1,x:3", "expected one of sphere:X,Y[,Z]:R"),
        ("sphere:1,2,3:0.5", "expected points of 2 components"),
        ("sphere:3,1.2:-1", "radius -1: expected more than 0"),
        ("sphere:nan,1.2:0.3", "sphere: expected finite numbers"),
        ("capsule:1,2:1,2,3:0.5", "expected 2 or 3 components, as many of each point"),
        ("plane:1,2:0,0", "expected a normal other than 0"),
        ("sphere:0,1.2:0.3", "the tool overlaps nodes that are held"),
        ("sphere:2,0.5:9", "the tool overlaps nodes that are held"),
    ],
)
def test_wrong_tools(
    tool: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.npz"
    assert message in refusal(["solve", "beam2d", "--tool", tool, "--out", str(out)], capsys)
    assert not out.exists()


def test_a_tool_in_the_middle_of_a_body() -> None:
    """It meets no node of the surface, and so pushes nothing out of its way."""
    with pytest.raises(WorkError, match="inside the tool, expected one that comes from out"):
        solve("beam2d", tool="capsule:2,0.333:2.3,0.333:0.1")


def test_a_body_inside_a_tool() -> None:
    mesh = make_mesh(Box(lower=(0, 0), upper=(1, 1), elements=(2, 2)), MPI.COMM_SELF)
    problem = EquilibriumProblem(mesh, MATERIAL, np.zeros((9, 2), bool), SolverSettings())
    with pytest.raises(InputError, match="the whole body lies inside the tool"):
        touched(problem, Sphere((0.5, 0.5), 3.0), np.arange(9))


def graded() -> np.ndarray:
    """Positions along an axis in m: equal cells, then a geometric series to the end."""
    rest = SIZE - EQUAL * FIRST

    def excess(ratio: float) -> float:
        return float(FIRST * (ratio ** np.arange(1, CELLS - EQUAL + 1)).sum() - rest)

    ratio = brentq(excess, 1.0, 4.0, xtol=1e-12)
    sizes = np.append(np.full(EQUAL, FIRST), FIRST * ratio ** np.arange(1, CELLS - EQUAL + 1))
    return np.concatenate([[0.0], np.cumsum(sizes)])


@pytest.mark.slow
def test_force_of_hertz() -> None:
    """Within 2 %; meshes with smaller cells give +1.0 to +1.9 %. No node is inside."""
    raw = box((1.0,) * 3, (CELLS,) * 3, simplices=False)
    places, lines = np.rint(CELLS * raw.coordinates).astype(int), graded()
    x = np.column_stack([lines[places[:, 0]], lines[places[:, 1]], -lines[CELLS - places[:, 2]]])
    mesh = distributed(replace(raw, coordinates=x), MPI.COMM_SELF)
    x = mesh.coordinates
    held = np.column_stack([x[:, 0] == 0, x[:, 1] == 0, np.zeros(len(x), bool)])
    held[np.isclose(x[:, 2], -SIZE)] = True
    settings = SolverSettings(linear_solver="lu")
    material = NeoHookean(young_modulus=YOUNG, poisson_ratio=POISSON)
    problem = EquilibriumProblem(mesh, material, held, settings)
    tool = Sphere((0.0, 0.0, RADIUS), RADIUS + DEPTH)
    top = np.flatnonzero((x[:, 2] == 0) & (np.hypot(x[:, 0], x[:, 1]) < SIZE / 4))
    problem.load.contact = touched(problem, tool, top)
    nothing = np.empty(0, dtype=np.int64), np.empty((0, 3))
    assert solve_load_case(problem, *nothing, settings).solved
    contact = problem.load.contact.found(problem.displacement())
    hertz = 4 / 3 * YOUNG / (1 - POISSON**2) * RADIUS**0.5 * DEPTH**1.5
    assert -4 * contact.reaction[2] == pytest.approx(hertz, rel=0.02)
    assert contact.penetration < 1e-12
    assert contact.nodes > 10


def rubbed_block(
    d: int, friction: float, depth: float, shift: float
) -> tuple[EquilibriumProblem, np.ndarray]:
    """A clamped unit box under a plane that goes down, then sideways; forces of the plane."""
    mesh = make_mesh(Box(lower=(0,) * d, upper=(1,) * d, elements=(4,) * d), MPI.COMM_SELF)
    settings = SolverSettings(linear_solver="lu")
    clamped = np.repeat(mesh.coordinates[:, -1:] == 0, d, axis=1)
    problem = EquilibriumProblem(mesh, MATERIAL, clamped, settings)
    up, along = np.eye(d)[-1], np.eye(d)[0]
    plane = Plane(tuple(up * (1 - depth)), tuple(-up))
    way = np.array([(depth + 0.1) * up - shift * along, -shift * along])
    surface = np.unique(boundary_facets(mesh.cells, mesh.cell_type))
    problem.load.contact = touched(problem, plane, surface, friction, way)
    report = solve_load_case(problem, np.empty(0, dtype=np.int64), np.empty((0, d)), settings)
    assert report.solved, report.explanation
    found = problem.load.contact.found(problem.displacement())
    assert found.penetration < 1e-9
    return problem, found.force


@pytest.mark.parametrize("d", [2, 3])
def test_a_plane_that_sticks_takes_its_nodes_along(d: int) -> None:
    """The same as to prescribe the displacement of the upper face."""
    depth, shift = 0.15, 0.1
    problem, forces = rubbed_block(d, 20.0, depth, shift)
    mesh, u = problem.mesh, problem.displacement()
    top = mesh.coordinates[:, -1] == 1
    np.testing.assert_allclose(u[top, 0], shift, atol=1e-9)
    np.testing.assert_allclose(u[top, -1], -depth, atol=1e-9)
    settings = SolverSettings(linear_solver="lu")
    moved = np.repeat(top[:, None], d, axis=1)
    clamped = np.repeat(mesh.coordinates[:, -1:] == 0, d, axis=1)
    held = EquilibriumProblem(mesh, MATERIAL, clamped, settings, moved=moved)
    wanted = np.where(moved, np.array([shift, *(0,) * (d - 2), -depth]), 0.0)
    nothing = np.empty(0, dtype=np.int64), np.empty((0, d))
    assert solve_load_case(held, *nothing, settings, displacement=wanted).solved
    np.testing.assert_allclose(u, held.displacement(), atol=1e-8)
    expected = np.where(moved, held.reactions(), 0.0)
    np.testing.assert_allclose(forces, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("d", [2, 3])
def test_a_plane_that_slips_drags_with_its_share_of_the_normal_force(d: int) -> None:
    """Amontons: every node bears |f_t| = μ f_n, against its slip, so that the sum does."""
    mu = 0.15
    _, forces = rubbed_block(d, mu, 0.1, 0.6)
    pushed = forces[forces.any(axis=1)]
    normal, across = -pushed[:, -1], np.linalg.norm(pushed[:, :-1], axis=1)
    assert (normal > 0).all()
    np.testing.assert_allclose(across, mu * normal, rtol=1e-6)
    total = forces.sum(axis=0)
    assert total[0] == pytest.approx(-mu * total[-1], rel=1e-3 if d == 3 else 1e-6)
    assert total[0] > 0


def test_action_and_reaction_with_a_disc() -> None:
    """Within the cone of friction at every node, balanced by the supports; a dead load alike."""
    mu = 0.4
    fine = ["mesh.elements=[60, 16]"]
    solution = solve("beam2d", tool=DISC, friction=mu, tool_from=["0,0.4"], changes=fine)
    contact, disc = solution.contact, parse_tool(DISC, 2)
    assert contact is not None
    assert contact.nodes > 1
    x = solution.coordinates + solution.displacement
    pushed = contact.force.any(axis=1)
    n = disc.normal(x[pushed])
    normal = (contact.force[pushed] * n).sum(axis=1)
    across = contact.force[pushed] - normal[:, None] * n
    assert disc.gap(x[pushed]) == pytest.approx(0, abs=1e-9)
    assert (np.linalg.norm(across, axis=1) <= mu * normal * (1 + 1e-9)).all()
    assert contact.force.sum(0) == pytest.approx(-solution.reactions.sum(0), rel=1e-7)
    as_load = solve("beam2d", contact.force, changes=fine)
    assert as_load.displacement == pytest.approx(solution.displacement, abs=1e-7)


def test_error_falls_with_the_load_steps() -> None:
    """To first order: halving the steps halves the difference from the next halving."""
    found = []
    for steps in (20, 40, 80):
        changes = ["mesh.elements=[24, 8]", f"solver.first_step={1 / steps}"]
        way = ["-0.3,0.3", "-0.3,0"]
        solution = solve("beam2d", tool=DISC, friction=0.3, tool_from=way, changes=changes)
        assert solution.contact is not None
        found.append(solution.contact.reaction)
    first, second = np.abs(np.diff(found, axis=0)).max(axis=1)
    assert second < 0.8 * first


def test_without_friction_the_way_does_not_matter() -> None:
    straight = solve("beam2d", tool=DISC)
    around = solve("beam2d", tool=DISC, tool_from=[(-0.5, 0.4), (-0.5, 0.05)])
    assert around.displacement == pytest.approx(straight.displacement, abs=1e-8)


def test_way() -> None:
    """Parts of the length; the last point is the place itself."""
    way = Way(np.array([[0.0, 3.0], [4.0, 3.0]]))  # lengths 4 and 5
    assert way.at(0.0) == pytest.approx([0, 3])
    assert way.at(2 / 9) == pytest.approx([2, 3])
    assert way.at(6.5 / 9) == pytest.approx([2, 1.5])
    assert way.at(1.0) == pytest.approx([0, 0])
    assert Way(np.zeros((0, 2))).at(0.3) == pytest.approx([0, 0])


@pytest.mark.mpi
def test_two_processes(tmp_path: Path) -> None:
    words = ["solve", "beam2d", "--tool", DISC, "--friction", "0.3", "--tool-from=-0.3,0.4"]
    words += ["--tool-from=-0.3,0", "--out"]
    one, two = str(tmp_path / "one.npz"), str(tmp_path / "two.npz")
    assert main([*words, one]) == 0
    done = finish(datagen(*words, two, ranks=2))
    assert done.returncode == 0, done.stderr
    assert "tool: force " in done.stdout
    with np.load(one) as expected, np.load(two) as found:
        for name in ("displacement", "force"):
            assert found[name] == pytest.approx(expected[name], abs=1e-7)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--load", "4,1:0,1", "--friction", "0.3"], "expected with --tool"),
        (["--load", "4,1:0,1", "--tool-from", "0,1"], "expected with --tool"),
        (["--tool", DISC, "--friction", "0.3"], "friction depends on the tool's way, expected"),
        (["--tool", DISC, "--friction", "nan", "--tool-from", "0,1"], "expected a number from 0"),
        (["--tool", DISC, "--friction=-1", "--tool-from", "0,1"], "expected a number from 0"),
        (["--tool", DISC, "--tool-from", "0,0,1"], "expected 2 finite numbers"),
        (["--tool", DISC, "--tool-from", "0,inf"], "expected 2 finite numbers"),
        (["--tool", DISC, "--tool-from", "0,x"], "expected 2 finite numbers"),
        (["--tool", DISC, "--tool-from", "0,-0.5"], "inside the body, expected it outside"),
    ],
)
def test_wrong_ways(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.npz"
    assert message in refusal(["solve", "beam2d", *words, "--out", str(out)], capsys)
    assert not out.exists()
