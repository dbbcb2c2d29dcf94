from __future__ import annotations

import numpy as np
import pytest
import torch
from sklearn.linear_model import Ridge

from surrogate.contrib.regressions import RidgeRegression, monomials

GENERATOR = torch.Generator()


def forces(count: int, nodes: int = 4, d: int = 2) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    return torch.rand(count, d, nodes, generator=generator, dtype=torch.float64) * 2 - 1


def test_monomials_by_hand() -> None:
    """Forces at two nodes are (2, 3) and (5, 7); the monomials are y, y², x, x y, x²."""
    found = monomials(torch.tensor([[[2.0, 5.0], [3.0, 7.0]]]), 2)
    expected = [3, 7, 9, 49, 2, 5, 6, 35, 4, 25]
    assert found.tolist() == [expected]


@pytest.mark.parametrize(("d", "degree", "a_node"), [(2, 1, 2), (2, 3, 9), (3, 3, 19)])
def test_number_of_monomials(d: int, degree: int, a_node: int) -> None:
    """The number of monomials per node is binomial(d + degree, d) − 1."""
    assert monomials(forces(1, 4, d), degree).shape == (1, 4 * a_node)


def test_linear_map_is_recovered() -> None:
    rng = np.random.default_rng(1)
    force = forces(200)
    weights, intercept = torch.from_numpy(rng.normal(size=(8, 3))), torch.tensor([1.0, -2.0, 0.5])
    outputs = force.swapaxes(1, 2).flatten(1) @ weights + intercept
    model = RidgeRegression(degree=1, penalty=1e-12)
    model.fit(force, outputs, GENERATOR)
    new = forces(7) * 3
    found, std = model(new)
    torch.testing.assert_close(found, new.swapaxes(1, 2).flatten(1) @ weights + intercept)
    assert std is None


def test_cubic_of_each_node_is_recovered() -> None:
    """The fit recovers x³ − 2 x y² at one node plus y² at another, but no product of both."""
    force = forces(300)
    x, y = force[:, 0], force[:, 1]
    output = x[:, 0] ** 3 - 2 * x[:, 0] * y[:, 0] ** 2 + y[:, 2] ** 2
    model = RidgeRegression(degree=3, penalty=1e-12)
    model.fit(force, output[:, None], GENERATOR)
    torch.testing.assert_close(model(force)[0], output[:, None], rtol=0, atol=1e-7)
    between = x[:, 0] * x[:, 1]
    model.fit(force, between[:, None], GENERATOR)
    assert (model(force)[0] - between[:, None]).abs().mean() > 0.1


def test_penalty_is_of_the_mean_square() -> None:
    """The minimum of ‖X W − Y‖² / N + α ‖W‖² comes from the normal equations of centred data."""
    force, alpha = forces(50), 0.3
    outputs = torch.from_numpy(np.random.default_rng(2).normal(size=(50, 2)))
    model = RidgeRegression(degree=2, penalty=alpha)
    model.fit(force, outputs, GENERATOR)
    x = monomials(force, 2).numpy()
    x, y = x - x.mean(axis=0), outputs.numpy() - outputs.numpy().mean(axis=0)
    expected = np.linalg.solve(x.T @ x / 50 + alpha * np.eye(x.shape[1]), x.T @ y / 50)
    np.testing.assert_allclose(model.weights.numpy(), expected.T, atol=1e-12)


def test_predicts_as_scikit_learn_does() -> None:
    force = forces(60)
    outputs = torch.sin(force.flatten(1)[:, :3])
    model = RidgeRegression(degree=4, penalty=1e-6)
    model.fit(force, outputs, GENERATOR)
    theirs = Ridge(alpha=60e-6).fit(monomials(force, 4).numpy(), outputs.numpy())
    new = forces(9) * 0.7
    expected = theirs.predict(monomials(new, 4).numpy())
    np.testing.assert_allclose(model(new)[0].numpy(), expected, atol=1e-9)
