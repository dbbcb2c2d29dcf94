"""Forces and tangents are derivatives of the energy; the factory's are compared end to end."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from shared_schema.materials import NeoHookean
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.solids.solid import Solid
from tests.surrogate.mechanics.bodies import MATERIAL, box
from tests.surrogate.plane_strain import plane_strain_stiffness

CELL_TYPES = ["quad", "triangle", "hexahedron", "tetra"]
QUADRATIC = NeoHookean(young_modulus=500, poisson_ratio=0.4, volumetric="quadratic")


def solid_of(geometry: Geometry, material: NeoHookean = MATERIAL) -> Solid:
    return Solid(geometry.coordinates, geometry.cells, geometry.cell_type, material)


def displacements(geometry: Geometry) -> torch.Tensor:
    noise = np.random.default_rng(0).normal(size=(3, *geometry.coordinates.shape))
    return torch.from_numpy(0.02 * noise)


@pytest.mark.parametrize("material", [MATERIAL, QUADRATIC], ids=["paper", "quadratic"])
@pytest.mark.parametrize("cell_type", CELL_TYPES)
def test_forces_and_tangents_are_derivatives(cell_type: str, material: NeoHookean) -> None:
    geometry = box(cell_type)
    solid, u = solid_of(geometry, material), displacements(geometry).requires_grad_()
    forces = solid.internal_forces(u)
    (expected,) = torch.autograd.grad(solid.energy(u).sum(), u)
    torch.testing.assert_close(forces, expected, rtol=1e-12, atol=1e-11)
    direction = displacements(geometry).flip(0)
    (expected,) = torch.autograd.grad((forces * direction).sum(), u)
    d = u.shape[2]
    at_cells = direction[:, solid.cells].flatten(2)
    products = torch.einsum(
        "ncij,ncj->nci", solid.compiled.cell_tangents(u.detach().numpy()), at_cells
    )
    found = torch.zeros_like(u).index_add(1, solid.cells.flatten(), products.reshape(3, -1, d))
    torch.testing.assert_close(found, expected, rtol=1e-11, atol=1e-10)


def test_tangent_at_rest_is_linear_elasticity() -> None:
    geometry = box("quad")
    entries = solid_of(geometry).stiffness_at_rest()[0].numpy()
    dofs = (2 * geometry.cells[:, :, None] + np.arange(2)).reshape(len(entries), -1)
    k = np.zeros(2 * (geometry.coordinates.size,))
    for cell, matrix in zip(dofs, entries, strict=True):
        k[np.ix_(cell, cell)] += matrix
    np.testing.assert_allclose(k, plane_strain_stiffness(geometry), atol=1e-11)


@pytest.mark.parametrize("cell_type", CELL_TYPES)
def test_rigid_motions_cost_nothing(cell_type: str) -> None:
    geometry = box(cell_type)
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=2 * (geometry.dimension,)))
    turn[0] *= np.linalg.det(turn)
    u = torch.from_numpy(geometry.coordinates @ turn.T - geometry.coordinates + 0.3)[None]
    solid = solid_of(geometry)
    assert solid.energy(u).item() == pytest.approx(0, abs=1e-10)
    assert solid.internal_forces(u).abs().max() < 1e-11


def test_inverted_cells_are_counted() -> None:
    """Node 27 is at (2, 1), in cell 17 alone; at x = 1.5, left of its neighbours, it inverts it."""
    geometry = box("quad")
    u = torch.zeros(3, 28, 2, dtype=torch.float64)
    u[1, 27, 0], u[2, 27, 0] = -0.5, math.nan
    solid = solid_of(geometry)
    assert solid.inverted(u).tolist() == [0, 1, 1]
    assert solid.energy(u)[:2].tolist() == [0, math.inf]


def test_single_precision() -> None:
    geometry = box("hexahedron")
    u, solid = displacements(geometry), solid_of(geometry)
    expected = solid.internal_forces(u)
    found = solid.to(torch.float32).internal_forces(u.float())
    assert (found - expected).abs().max() < 1e-5 * expected.abs().max()


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_the_same_on_a_gpu() -> None:
    geometry = box("hexahedron")
    u, solid = displacements(geometry), solid_of(geometry)
    expected = solid.energy(u), solid.internal_forces(u)
    solid, u = solid.cuda(), u.cuda()
    found = solid.energy(u), solid.internal_forces(u)
    for one, other in zip(found, expected, strict=True):
        torch.testing.assert_close(one.cpu(), other, rtol=1e-11, atol=1e-11)
