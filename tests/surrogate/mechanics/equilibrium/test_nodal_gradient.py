"""The nodal gradient against linear fields, and against central differences."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from shared_schema.common.bodies.reference_cells import CORNERS, shape_gradients
from surrogate.mechanics.equilibrium.linear_response import nodal_gradient
from surrogate.mechanics.matrices.sparse_products import SparseProduct

CUBE = np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)
SQUARE = CUBE[:4, :2]
MESHES = {  # coordinates and cells; each distorted below
    "triangle": (SQUARE, [[0, 1, 2], [0, 2, 3]]),
    "quad": (np.concatenate([SQUARE, [[2, 0], [2, 1]]]), [[0, 1, 2, 3], [1, 4, 5, 2]]),
    "tetra": (CUBE, [[0, 1, 3, 4], [1, 2, 3, 6], [1, 3, 4, 6], [1, 6, 4, 5], [3, 4, 6, 7]]),
    "hexahedron": (CUBE, [[0, 1, 2, 3, 4, 5, 6, 7]]),
}


@pytest.mark.parametrize("cell_type", MESHES)
def test_linear_fields_are_exact(cell_type: str) -> None:
    """u = G x + c has the gradient G at every node, on distorted meshes as well."""
    rng = np.random.default_rng(0)
    x, cells = MESHES[cell_type]
    x = x + 0.1 * rng.normal(size=x.shape)
    gradient, offset = rng.normal(size=x.shape[1] * np.array((1, 1))), rng.normal(size=x.shape[1])
    u = x @ gradient.T + offset
    operators = nodal_gradient(x, np.array(cells), cell_type)
    found = np.stack([operator @ u for operator in operators], axis=-1)
    np.testing.assert_allclose(found, np.broadcast_to(gradient, found.shape), atol=1e-12)


@pytest.mark.parametrize("cell_type", MESHES)
def test_gradients_of_shape_functions_add_up_to_nothing(cell_type: str) -> None:
    """Shape functions add up to one."""
    corners = np.array(CORNERS[cell_type], dtype=np.float64)
    np.testing.assert_allclose(shape_gradients(cell_type, corners).sum(axis=1), 0, atol=1e-15)


def test_central_differences_inside_a_regular_grid() -> None:
    """On squares of side h: (u(x + h) − u(x − h)) / 2h at the middle of 3 × 3 nodes."""
    x = np.array([(i, j) for i in range(3) for j in range(3)]) * 0.5
    cells = np.array([[0, 3, 4, 1], [3, 6, 7, 4], [1, 4, 5, 2], [4, 7, 8, 5]])
    u = np.random.default_rng(1).normal(size=9)
    by_x, by_y = (operator @ u for operator in nodal_gradient(x, cells, "quad"))
    assert by_x[4] == pytest.approx((u[7] - u[1]) / 1.0)
    assert by_y[4] == pytest.approx((u[5] - u[3]) / 1.0)


def test_product_by_padded_rows() -> None:
    x, cells = MESHES["quad"]
    operator = nodal_gradient(x, np.array(cells), "quad")[0]
    u = np.random.default_rng(2).normal(size=(len(x), 3))
    found = SparseProduct(operator, torch.float64)(torch.from_numpy(u))
    np.testing.assert_allclose(found.numpy(), operator @ u, atol=1e-14)
