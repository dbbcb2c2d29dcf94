"""Maps between mesh and grid in PyTorch, compared with those in NumPy and by hand."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from shared_schema.grid import Grid
from shared_schema.layout import NO_NODE
from surrogate.learning.networks.load_count_factor import LoadCountFactor
from surrogate.learning.networks.nodal_network import NodalNetwork
from surrogate.learning.probabilistic.likelihoods import Prediction
from surrogate.mechanics.matrices.sparse_products import WeightedSums, matrix_of

RNG = np.random.default_rng(0)


def permuted(shape: tuple[int, ...], empty: int = 0) -> Grid:
    """Return a grid with nodes in random order and some empty points."""
    points = int(np.prod(shape))
    node_at = np.full(points, NO_NODE)
    node_at[RNG.permutation(points)[empty:]] = np.arange(points - empty)
    return Grid.of_nodes(node_at.reshape(shape))


def embedded() -> Grid:
    """Return a 4 × 3 grid with nine nodes, each mapped to at most four points; not all are used."""
    points = np.stack([RNG.permutation(11)[:4] for _ in range(9)])
    weights = RNG.dirichlet(np.ones(4), 9) * (RNG.random((9, 4)) > 0.2)
    sources = RNG.integers(0, 9, (4, 3, 3))
    return Grid(sources, np.full((4, 3, 3), 1 / 3), points, weights)


class Field(nn.Module):
    """A network that returns the forces as means, and twice the forces as standard deviations."""

    members = 1
    force_scale = aleatoric_factor = epistemic_factor = torch.ones(())

    def __init__(self) -> None:
        super().__init__()
        self.count_factor = LoadCountFactor()

    def forward(self, force: Tensor, passes: int, by_component: Tensor | None) -> Prediction:
        repeated = force.repeat(passes, *[1] * (force.ndim - 1))
        return Prediction(repeated, 2 * repeated)


@pytest.mark.parametrize(
    "grid",
    [permuted((5, 4)), permuted((5, 4), empty=6), permuted((3, 4, 2)), embedded()],
    ids=["permuted", "with empty points", "3D", "embedded"],
)
def test_maps_are_those_of_the_schema(grid: Grid) -> None:
    """F = Bᵀ f and u = B U agree with those of `shared_schema`, to float32 round-off."""
    d = len(grid.shape)
    force = RNG.normal(size=(2, grid.nodes, d)).astype(np.float32)
    network = NodalNetwork(Field(), grid)  # type: ignore[arg-type]
    mean, std = network(torch.from_numpy(force))
    expected = grid.to_nodes(grid.forces_to_grid(force))
    assert mean.shape == (1, 2, grid.nodes, d)
    np.testing.assert_allclose(mean[0], expected, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(std[0], 2 * expected, rtol=1e-6, atol=1e-6)


def test_passes_are_parts_of_the_batch() -> None:
    """The batch of three passes contains the samples three times."""
    grid = permuted((3, 2))
    network = NodalNetwork(Field(), grid)  # type: ignore[arg-type]
    force = torch.from_numpy(RNG.normal(size=(2, 6, 2)).astype(np.float32))
    mean, _ = network(force, 3)
    assert torch.equal(mean, force.expand(3, 2, 6, 2))


def test_weighted_sums_by_hand() -> None:
    """2·5 + 3·7 = 31; 1·11."""
    matrix = matrix_of(np.array([[0, 1], [2, -1]]), np.array([[2.0, 3.0], [1.0, 0.0]]), 3)
    sums = WeightedSums(matrix)
    assert sums(torch.tensor([[5.0, 7.0, 11.0]])).tolist() == [[31.0, 11.0]]


def test_matrix_by_hand() -> None:
    """Its rows need not be in order, and one column is empty."""
    matrix = matrix_of(np.array([[0, 1], [2, 0]]), np.array([[2.0, 3.0], [1.0, 4.0]]), 4)
    assert matrix.toarray().tolist() == [[2, 3, 0, 0], [4, 0, 1, 0]]


@pytest.mark.parametrize("k", [1, 3])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_sums_with_and_without_gradients_are_the_same(k: int, dtype: torch.dtype) -> None:
    """Also of the last inputs, which no output has, and with weights of zero."""
    sources, weights = (
        RNG.integers(0, 7, (9, k)),
        RNG.normal(size=(9, k)) * RNG.integers(0, 2, (9, k)),
    )
    sums, values = WeightedSums(matrix_of(sources, weights, 11)), RNG.normal(size=(30, 2, 11))
    tracked = torch.tensor(values, dtype=dtype, requires_grad=True)
    expected = (weights * values[..., sources]).sum(axis=-1)
    for found in (sums(tracked), sums(tracked.detach())):
        assert found.dtype == dtype
        np.testing.assert_allclose(found.detach(), expected, rtol=0, atol=1e-6)
