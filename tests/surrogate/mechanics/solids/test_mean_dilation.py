"""Solids whose cells change their volume as a whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from shared_schema.materials import NeoHookean
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.solids.deformation import energy_density
from surrogate.mechanics.solids.mixed_elements import MeanDilationSolid
from tests.surrogate.mechanics.bodies import box, end_load

SILICONE = NeoHookean(young_modulus=500, poisson_ratio=0.499)
CELLS = ["quad", "hexahedron"]


def soft(cell_type: str) -> Geometry:
    """A box of such cells."""
    return replace(box(cell_type), mean_dilation=True)


def solid_of(geometry: Geometry) -> MeanDilationSolid:
    """The solid alone."""
    body = geometry.coordinates, geometry.cells, geometry.cell_type
    return MeanDilationSolid(*body, SILICONE)


@pytest.mark.parametrize("cell_type", CELLS)
def test_homogeneous_deformation(cell_type: str) -> None:
    """All points have the same J: E = W(F) V, with W of the material."""
    geometry = soft(cell_type)
    x, d = torch.from_numpy(geometry.coordinates), geometry.dimension
    f = torch.eye(d) + torch.from_numpy(0.1 * np.random.default_rng(0).normal(size=(d, d)))
    expected = energy_density(f, SILICONE) * 2.0
    energy = solid_of(geometry).energy((x @ (f.T - torch.eye(d)))[None])
    assert energy.item() == pytest.approx(expected.item(), rel=1e-12)


@pytest.mark.parametrize("cell_type", CELLS)
def test_derivatives(cell_type: str) -> None:
    """Forces and tangents are the derivatives of the energy, by central differences."""
    geometry = soft(cell_type)
    solid, random = solid_of(geometry), np.random.default_rng(0)
    u, v = (
        torch.from_numpy(0.03 * random.normal(size=(1, *geometry.coordinates.shape))) for _ in "uv"
    )
    step = 1e-6
    slope = (solid.energy(u + step * v) - solid.energy(u - step * v)) / (2 * step)
    forces = solid.internal_forces(u)
    assert (forces * v).sum().item() == pytest.approx(slope.item(), rel=1e-6)
    change = (solid.internal_forces(u + step * v) - solid.internal_forces(u - step * v)) / (
        2 * step
    )
    corners = v[0][solid.cells].flatten(1)
    product = torch.einsum("cij,cj->ci", solid.compiled.cell_tangents(u.numpy())[0], corners)
    of_cells = product.reshape(len(corners), -1, geometry.dimension)[:, None].transpose(-1, -2)
    np.testing.assert_allclose(
        solid.sum_at_nodes(of_cells), change, rtol=0, atol=1e-6 * float(change.abs().max())
    )


def test_inverted_cell_has_infinite_energy() -> None:
    geometry = soft("quad")
    u = torch.zeros(1, *geometry.coordinates.shape, dtype=torch.float64)
    u[0, -1] = -3.0
    assert solid_of(geometry).energy(u).item() == np.inf


def test_it_does_not_lock() -> None:
    """Bending: with ν = 0.499, linear elements move a third as far at most."""
    geometry = soft("quad")
    moved = []
    for body in (geometry, replace(geometry, mean_dilation=False)):
        force = end_load(geometry, 0.0, -1.0)[None]
        moved.append(np.abs(Equilibrium(body, SILICONE).linear_response(force)).max())
    assert moved[1] < moved[0] / 3
