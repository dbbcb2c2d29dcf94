"""The compliance of a body: dense, by columns, and by solves, against a dense inverse."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from shared_schema.common.bodies.cell_volumes import nodal_volumes
from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.mechanics.equilibrium import compliance, kept_responses
from surrogate.mechanics.equilibrium.block_solve import BlockSolve
from surrogate.mechanics.equilibrium.compliance import Compliance
from surrogate.mechanics.equilibrium.kept_responses import KeptResponses
from surrogate.mechanics.matrices.factors import BandCholesky
from tests.surrogate.plane_strain import plane_strain_stiffness


@pytest.fixture(scope="module")
def inverse(dataset: Dataset) -> np.ndarray:
    """K⁻¹ of the free degrees of freedom, component by component."""
    free = np.flatnonzero(~dataset.geometry.clamped)
    dofs = (2 * free + np.arange(2)[:, None]).ravel()
    result: np.ndarray = np.linalg.inv(plane_strain_stiffness(dataset.geometry)[np.ix_(dofs, dofs)])
    return result


@pytest.fixture
def large(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> Compliance:
    """The compliance as of a body with too many degrees of freedom for a dense matrix."""
    monkeypatch.setattr(compliance, "DENSE", 0)
    return Compliance(dataset.geometry, dataset.material)


def loads(n: int, samples: int, loaded: int) -> np.ndarray:
    """Random forces on a few random degrees of freedom of every sample."""
    rng = np.random.default_rng(0)
    force = np.zeros((samples, n), dtype=np.float32)
    for row in force:
        row[rng.choice(n, loaded, replace=False)] = rng.normal(size=loaded)
    return force


def assert_close(found: torch.Tensor, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-6 * np.abs(expected).max())


def test_dense_matrix_of_a_small_body(dataset: Dataset, inverse: np.ndarray) -> None:
    small = Compliance(dataset.geometry, dataset.material)
    assert_close(small.matrix, inverse)
    assert small.factor is None
    force = loads(small.size, 5, small.size)
    assert_close(small(torch.from_numpy(force)), force @ inverse)


def test_block_elimination_of_an_exported_file(large: Compliance, inverse: np.ndarray) -> None:
    """In single precision; its refinements make it as accurate as the factor."""
    assert large.factor is not None
    solve = BlockSolve(large)
    assert len(solve.starts) > 2
    force = loads(large.size, 3, 5)
    expected = force @ inverse
    found = solve(torch.from_numpy(force).double())
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize(("samples", "loaded"), [(1, 3), (3, 8), (40, 3), (2, 56)])
def test_a_large_body_responds_by_columns_or_solves(
    large: Compliance, inverse: np.ndarray, samples: int, loaded: int
) -> None:
    force = loads(large.size, samples, loaded)
    for _ in range(2):  # the second time from the columns that are kept
        assert_close(large(torch.from_numpy(force)), force @ inverse)


@pytest.mark.parametrize("dense", [0, 10**6])
def test_one_load_at_all_nodes(
    dataset: Dataset, inverse: np.ndarray, dense: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Zero at clamped nodes, whatever acts there."""
    monkeypatch.setattr(compliance, "DENSE", dense)
    found = Compliance(dataset.geometry, dataset.material)
    force = np.random.default_rng(0).normal(size=dataset.geometry.coordinates.shape)
    free = ~dataset.geometry.clamped
    expected = np.zeros_like(force)
    expected[free] = (force[free].T.ravel() @ inverse).reshape(2, -1).T
    for dtype in (np.float32, np.float64):
        u = found.respond_at_nodes(force[None].astype(dtype))[0]
        np.testing.assert_allclose(u, expected, atol=1e-6 * np.abs(expected).max())


def test_single_precision_only_where_it_suffices(
    large: Compliance, dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert isinstance(large.quick, BandCholesky)
    assert large.quick.factor.dtype == np.float32
    monkeypatch.setattr(compliance, "DENSE", 0)
    monkeypatch.setattr(compliance, "CLOSE", 1e-12)  # as if the body were slender
    careful = Compliance(dataset.geometry, dataset.material)
    assert careful.quick is careful.factor
    force = loads(careful.size, 40, careful.size)
    np.testing.assert_allclose(careful.solve(force), large.solve(force), rtol=0, atol=1e-5)


def test_columns_are_solved_for_once(
    large: Compliance, inverse: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    dofs, weights = np.array([3, 20]), np.array([2, -1], np.float32)
    found = large.kept.sum_of(dofs, weights)
    np.testing.assert_allclose(found, weights @ inverse[dofs], rtol=1e-4, atol=1e-6)
    monkeypatch.setattr(large.kept, "respond", None)
    np.testing.assert_array_equal(large.kept.sum_of(dofs[::-1], weights[::-1]), found)
    with pytest.raises(TypeError):
        large.kept.sum_of(np.array([4]), weights[:1])


def test_body_forces_cost_no_solve(
    large: Compliance, dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A uniform body force beside forces on nodes that are known: a sum of what is kept."""
    x, cells = dataset.geometry.coordinates, dataset.geometry.cells
    weight = np.outer(nodal_volumes(x, cells), [0.3, -1.7])
    touched = np.zeros_like(weight)
    touched[(~dataset.geometry.clamped).nonzero()[0][3]] = 0.4, 0.2
    force = np.stack([weight, weight + touched, touched])
    expected = large.respond_at_nodes(force)
    for _ in range(2):
        found = large.respond_at_nodes(force.astype(np.float32))
        np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
        monkeypatch.setattr(large, "solve", None)
    with pytest.raises(TypeError):
        large.respond_at_nodes((weight * x).astype(np.float32)[None])


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
    force = torch.from_numpy(loads(large.size, 2, 4)).requires_grad_()
    weights = torch.from_numpy(loads(large.size, 2, large.size))
    (large(force) * weights).sum().backward()
    assert force.grad is not None
    assert_close(force.grad, weights.numpy() @ inverse)
