"""The compliance of a body: dense, by columns, and by solves, against a dense inverse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.bodies.distributed_loads import nodal_volumes
from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.mechanics.equilibrium import compliance, kept_responses
from surrogate.mechanics.equilibrium.block_solve import BlockSolve
from surrogate.mechanics.equilibrium.compliance import Compliance
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.kept_responses import KeptResponses
from surrogate.mechanics.matrices import factors
from surrogate.mechanics.matrices.factors import BandCholesky
from tests.surrogate.mechanics.bodies import as_simplices
from tests.surrogate.plane_strain import plane_strain_stiffness


@pytest.fixture(scope="module")
def inverse(dataset: Dataset) -> np.ndarray:
    """K⁻¹ at all nodes, zero where they are held: (n_nodes · d, n_nodes · d)."""
    dofs = np.flatnonzero(dataset.geometry.free)
    result, k = np.zeros((dataset.geometry.coordinates.size,) * 2), np.ix_(dofs, dofs)
    result[k] = np.linalg.inv(plane_strain_stiffness(dataset.geometry)[k])
    return result


@pytest.fixture
def large(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> Compliance:
    """The compliance as of a body with too many degrees of freedom for a dense matrix."""
    monkeypatch.setattr(compliance, "DENSE", 0)
    return Compliance(dataset.geometry, dataset.material)


def loads(body: Compliance, samples: int, loaded: int | None = None) -> np.ndarray:
    """Random forces on a few random components of every sample, or on all: (samples, n, d)."""
    rng, free = np.random.default_rng(0), body.equilibrium.layout.dofs
    count = len(free) if loaded is None else loaded
    force = np.zeros((samples, body.equilibrium.free.size), dtype=np.float32)
    for row in force:
        row[rng.choice(free, count, replace=False)] = rng.normal(size=count)
    return force.reshape(samples, -1, 2)


def answers(force: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    result: np.ndarray = (force.reshape(len(force), -1) @ inverse).reshape(force.shape)
    return result


def assert_close(found: torch.Tensor, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-6 * np.abs(expected).max())


def test_dense_matrix_of_a_small_body(dataset: Dataset, inverse: np.ndarray) -> None:
    small = Compliance(dataset.geometry, dataset.material)
    dofs = small.dofs.numpy()
    assert_close(small.matrix, inverse[np.ix_(dofs, dofs)])
    force = loads(small, 5)
    assert_close(small(torch.from_numpy(force)), answers(force, inverse))


def test_block_elimination_of_an_exported_file(large: Compliance, inverse: np.ndarray) -> None:
    """In single precision; its refinements make it as accurate as the factor."""
    solve = BlockSolve(large.equilibrium)
    assert len(solve.starts) > 2
    force = loads(large, 3, 5)
    expected = answers(force, inverse)
    found = solve(torch.from_numpy(force).double())
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize(("samples", "loaded"), [(1, 3), (3, 8), (40, 3), (2, 56)])
def test_a_large_body_responds_by_columns_or_solves(
    large: Compliance, inverse: np.ndarray, samples: int, loaded: int
) -> None:
    force = loads(large, samples, loaded)
    for _ in range(2):  # the second time from the columns that are kept
        assert_close(large(torch.from_numpy(force)), answers(force, inverse))


@pytest.mark.parametrize("dense", [0, 10**6])
def test_one_load_at_all_nodes(
    dataset: Dataset, inverse: np.ndarray, dense: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Zero at clamped nodes, whatever acts there."""
    monkeypatch.setattr(compliance, "DENSE", dense)
    found = Compliance(dataset.geometry, dataset.material)
    force = np.random.default_rng(0).normal(size=dataset.geometry.coordinates.shape)
    expected = answers(force[None], inverse)[0]
    for dtype in (np.float32, np.float64):
        u = found.respond(force[None].astype(dtype))[0]
        np.testing.assert_allclose(u, expected, atol=1e-6 * np.abs(expected).max())


def test_single_precision_only_where_it_suffices(
    large: Compliance, dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert isinstance(large.equilibrium.rough, BandCholesky)
    assert large.equilibrium.rough.factor.dtype == np.float32
    monkeypatch.setattr(compliance, "DENSE", 0)
    monkeypatch.setattr(factors, "CLOSE", 1e-12)  # as if the body were slender
    careful = Compliance(dataset.geometry, dataset.material)
    assert careful.equilibrium.rough is careful.equilibrium.undeformed
    force = loads(careful, 40)
    np.testing.assert_allclose(careful.solve(force), large.solve(force), rtol=0, atol=1e-5)


def test_columns_are_solved_for_once(
    large: Compliance, inverse: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    dofs, weights = large.dofs[[3, 20]].numpy(), np.array([2, -1], np.float32)
    found = large.kept.sum_of(dofs, weights)
    np.testing.assert_allclose(found, weights @ inverse[dofs], rtol=1e-4, atol=1e-6)
    monkeypatch.setattr(large.kept, "respond", None)
    np.testing.assert_array_equal(large.kept.sum_of(dofs[::-1], weights[::-1]), found)
    with pytest.raises(TypeError):
        large.kept.sum_of(large.dofs[4:5].numpy(), weights[:1])


def test_body_forces_cost_no_solve(
    large: Compliance, dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A uniform body force beside forces on nodes that are known: a sum of what is kept."""
    x, cells = dataset.geometry.coordinates, dataset.geometry.cells
    weight = np.outer(nodal_volumes(x, cells), [0.3, -1.7])
    touched = np.zeros_like(weight)
    touched[(~dataset.geometry.clamped).nonzero()[0][3]] = 0.4, 0.2
    force = np.stack([weight, weight + touched, touched])
    expected = large.respond(force)
    for _ in range(2):
        found = large.respond(force.astype(np.float32))
        np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
        monkeypatch.setattr(large, "solve", None)
    with pytest.raises(TypeError):
        large.respond((weight * x).astype(np.float32)[None])


@pytest.mark.parametrize("points", [False, True], ids=["nodes", "points between nodes"])
def test_pressures_cost_no_solve(
    points: bool, dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pressure of the case at rest, beside a body force and forces on nodes: a sum as well."""
    monkeypatch.setattr(compliance, "DENSE", 0)
    monkeypatch.setattr(kept_responses, "LOADED", 2)
    body = as_simplices(dataset.geometry) if points else dataset.geometry
    x, cells = body.coordinates, body.cells
    facets = boundary_facets(cells, body.cell_type)
    top = (x[facets][..., 1] == x[:, 1].max()).all(axis=1)
    body = replace(body, has_points_between=points, pressed_by_corners=points)
    geometry = replace(body, pressed=facets[top])
    large = Compliance(geometry, dataset.material, on_points=points)
    pressure = FollowingLoads.of(geometry, np.array([[2.5]])).load[0]
    assert np.count_nonzero(pressure) > 2
    on_points = large.equilibrium.geometry
    weight = np.outer(nodal_volumes(on_points.coordinates, on_points.cells), [0.3, -1.7])
    touched = np.zeros_like(weight)
    touched[: len(x)] = pressure
    touched[(~geometry.clamped).nonzero()[0][3]] += 0.4, 0.2
    force = np.stack([np.zeros_like(weight), touched, touched + weight])
    force[0, : len(x)] = pressure
    expected = large.respond(force)
    for _ in range(2):
        found = large.respond(force.astype(np.float32))
        np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
        monkeypatch.setattr(large, "solve", None)


def test_columns_are_forgotten_where_there_is_no_room(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that are to be kept stay; what has no room at all is solved for each time."""
    monkeypatch.setattr(kept_responses, "KEPT", 5 * 4 * 40)
    monkeypatch.setattr(kept_responses, "LOADED", 3)
    matrix, solved = np.random.default_rng(0).normal(size=(40, 40)), []

    def respond(unit: np.ndarray) -> np.ndarray:
        solved.append(len(unit))
        return unit @ matrix

    kept = KeptResponses(respond, 40)
    assert kept.most == 5

    def ask(*numbers: int) -> int:
        weights = np.arange(1, len(numbers) + 1, dtype=np.float32)
        found = kept.sum_of(np.array(numbers), weights)
        np.testing.assert_allclose(found, weights @ matrix[list(numbers)], rtol=1e-5, atol=1e-6)
        return sum(solved)

    asked = (0, 1, 2), (2, 3), (1, 4, 5), (5, 1), (0,)
    assert [ask(*numbers) for numbers in asked] == [3, 4, 7, 7, 8]
    columns = kept.keep(np.array([7, 8, 9]))
    np.testing.assert_allclose(columns, matrix[7:10], rtol=1e-6)
    then = (7, 9), (1, 2), (3, 8), (7, 1), (1, 2, 3, 7)
    assert [ask(*numbers) for numbers in then] == [11, 13, 14, 15, 19]
    with pytest.raises(InputError, match=r"6 columns take 9.6e-07 GB, expected 8e-07 GB at most"):
        kept.keep(np.arange(6))
    many = np.zeros(40, np.float32)
    many[:4] = 1
    assert kept.answer(many) is None  # and not solved for


def test_derivative_of_the_response_is_the_response_to_gradients(
    large: Compliance, inverse: np.ndarray
) -> None:
    force = torch.from_numpy(loads(large, 2, 4)).requires_grad_()
    weights = torch.from_numpy(loads(large, 2))
    (large(force) * weights).sum().backward()
    assert force.grad is not None
    assert_close(force.grad, answers(weights.numpy(), inverse))
