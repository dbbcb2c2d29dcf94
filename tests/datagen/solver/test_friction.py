"""Coulomb friction with rigid tools: stick, slip, the way, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from datagen import solve
from datagen.mesh.distributed_mesh import make_mesh
from datagen.mesh.geometries import Box
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import SolverSettings
from datagen.solver.tool_contact import Way, touched
from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.materials import NeoHookean
from shared_schema.tools import Plane, parse_tool
from tests.datagen.farm_runs import datagen, finish
from tests.datagen.refusal import refusal

MATERIAL = NeoHookean(young_modulus=500, poisson_ratio=0.4)
DISC = "sphere:3,1.2:0.3"


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
    for steps in (40, 80, 160):
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
    fields = []
    for ranks in (0, 2):
        out = tmp_path / f"{ranks}.npz"
        done = finish(datagen(*words, "--tool-from=-0.3,0", "--out", out, ranks=ranks))
        assert done.returncode == 0, done.stderr
        with np.load(out) as found:
            fields.append([found["displacement"], found["force"]])
    for one, other in zip(*fields, strict=True):
        assert one == pytest.approx(other, abs=1e-7)


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
