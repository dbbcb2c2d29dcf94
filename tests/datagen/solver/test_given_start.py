"""A given start, however wrong, leads to the equilibrium that load stepping finds from rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from datagen.cases.body import Body
from datagen.cases.case import read_case
from datagen.discretisation.element import Element
from datagen.mesh.distributed_mesh import distributed
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import read_start, solve_from, solve_load_case
from datagen.solver.settings import SolverSettings
from shared_schema.common.errors import InputError
from shared_schema.materials import NeoHookean
from tests.datagen.solver.cantilever import bent, box

TOLERANCE = 1e-8  # N
SETTINGS = SolverSettings(tolerance=TOLERANCE)
MATERIAL = read_case("beam2d").material
NODES = np.array([63])  # the corner (4, 1) of the beam
FORCES = np.array([[0.5, -2.0]])


@pytest.fixture(scope="module")
def truth(beam: Body) -> np.ndarray:
    assert solve_load_case(beam.problem, NODES, FORCES, SETTINGS).solved
    return beam.problem.displacement()


def mirrored(x: np.ndarray) -> np.ndarray:
    """Displacement to the mirror image at x = 0."""
    image = np.zeros_like(x)
    image[:, 0] = -2 * x[:, 0]
    return image


def wrong_starts(truth: np.ndarray, x: np.ndarray) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    return {
        "at rest": np.zeros_like(x),
        "random": rng.normal(size=x.shape),
        "inverted": mirrored(x),
        "of the opposite load": -truth,
        "far away": 1e200 * truth,
        "no numbers": np.full_like(x, np.nan),
        "infinite": np.full_like(x, np.inf),
    }


def test_wrong_starts_cost_time_only(beam: Body, truth: np.ndarray) -> None:
    """The steps from rest are the same, so the results are the same bit for bit."""
    for name, start in wrong_starts(truth, beam.mesh.coordinates).items():
        report, used = solve_from(start, beam.problem, NODES, FORCES, SETTINGS)
        assert report.solved, name
        assert not used, name
        np.testing.assert_array_equal(beam.problem.displacement(), truth, err_msg=name)


def test_near_start_saves_iterations(beam: Body, truth: np.ndarray) -> None:
    """A tenth of a millimetre at the tip, of 1.6 m; the support's displacement is ignored."""
    x = beam.mesh.coordinates
    start = truth + 1e-4 * (x[:, :1] / 4) ** 2
    start[beam.clamped] = 7.0
    from_rest = solve_load_case(beam.problem, NODES, FORCES, SETTINGS)
    report, used = solve_from(start, beam.problem, NODES, FORCES, SETTINGS)
    assert used
    assert report.newton_iterations <= 2 < from_rest.newton_iterations
    assert report.residual_norm <= TOLERANCE
    np.testing.assert_allclose(beam.problem.displacement(), truth, atol=1e-8)


def test_potential_is_lowest_in_equilibrium(beam: Body, truth: np.ndarray) -> None:
    """Π is 0 at rest, stationary and lowest at the truth, infinite where an element is inverted."""
    x, problem = beam.mesh.coordinates, beam.problem
    problem.set_load(NODES, FORCES)
    found = []
    for part in (0.0, 0.99, 1.0, 1.01):
        problem.set_displacement(part * truth)
        found.append(problem.potential())
    assert found[0] == 0.0
    assert found[2] < min(found[1], found[3]) < 0.0
    problem.set_displacement(mirrored(x))
    assert problem.potential() == np.inf


def test_files_of_starts(beam: Body, truth: np.ndarray, tmp_path: Path) -> None:
    x, path = beam.mesh.coordinates, tmp_path / "start.npz"
    np.savez(path, coordinates=x, displacement=truth)
    np.testing.assert_array_equal(read_start(path, x), truth)
    for coordinates, displacement in ((x + 0.1, truth), (x[1:], truth[1:]), (x, truth[1:])):
        np.savez(path, coordinates=coordinates, displacement=displacement)
        with pytest.raises(InputError, match="on another mesh, expected"):
            read_start(path, x)
    np.savez(path, coordinates=x)
    for wrong in (path, tmp_path / "none.npz", tmp_path):
        with pytest.raises(InputError, match=r"expected a file \.npz with 'displacement'"):
            read_start(wrong, x)
    whole = path.read_bytes()
    for content in (b"no numbers", whole[:100], whole[100:]):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"expected a file \.npz"):
            read_start(path, x)


def test_multigrid_goes_no_further_than_the_tolerance(beam: Body, truth: np.ndarray) -> None:
    """From rest it goes on to a hundredth of the tolerance; afterwards it does so again."""
    settings = SolverSettings(tolerance=TOLERANCE, linear_solver="multigrid")
    problem = EquilibriumProblem(beam.mesh, MATERIAL, beam.clamped, settings)
    x = beam.mesh.coordinates
    start = truth + 1e-3 * (x[:, :1] / 4) ** 2
    report, used = solve_from(start, problem, NODES, FORCES, settings)
    assert used
    assert 1e-2 * TOLERANCE < report.residual_norm <= TOLERANCE
    np.testing.assert_allclose(problem.displacement(), truth, atol=1e-7)
    from_rest = solve_load_case(problem, NODES, FORCES, settings)
    assert from_rest.residual_norm <= 1e-2 * TOLERANCE
    assert report.newton_iterations < from_rest.newton_iterations
    problem.close()


def test_an_equilibrium_is_a_start_for_every_element_of_the_corners() -> None:
    """Its own equilibrium, by one or two iterations and not from rest."""
    mesh = distributed(box((4.0, 1.0), (12, 3), False), MPI.COMM_SELF)
    settings = SolverSettings()
    elements: tuple[Element, ...] = ("linear", "incompressible")
    material = NeoHookean(young_modulus=500, poisson_ratio=0.49)
    for element in elements:
        solved = bent(mesh, element, material, (0.0, -1.0), settings)
        problem, loaded = solved.problem, solved.loaded
        forces = np.zeros((len(loaded), 2))
        forces[:, 1] = -0.25
        assert solve_load_case(problem, loaded, forces, settings).solved
        expected = problem.displacement()
        report, used = solve_from(expected, problem, loaded, forces, settings)
        assert used
        assert report.newton_iterations <= 2
        assert problem.displacement() == pytest.approx(expected, abs=1e-9)
