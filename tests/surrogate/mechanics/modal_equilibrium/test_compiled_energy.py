"""Energy in modes of any material without fibres, beside that of the solid."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from surrogate.mechanics.modal_equilibrium import Cubature, ModalEquilibrium
from surrogate.mechanics.modal_equilibrium.compiled_energy import (
    energy_at,
    forces_of_points,
    points_of,
)
from surrogate.mechanics.solids.solid import Solid
from tests.surrogate.mechanics.series.test_body_series import body


def at_all_points(solid: Solid, modes: np.ndarray) -> ModalEquilibrium:
    """The equilibrium by all quadrature points, in random order."""
    volumes = solid.volumes.numpy()
    chosen = np.random.default_rng(0).permutation(volumes.size)
    every = Cubature(*np.divmod(chosen, volumes.shape[1]), volumes.ravel()[chosen])
    parts = solid.material_of_cells().numpy()
    gradients = solid.gradients.numpy()
    return ModalEquilibrium(modes, solid.cells.numpy(), gradients, every, solid.laws, parts, 2)


@pytest.mark.parametrize("material", ["st_venant_kirchhoff", "mooney_rivlin", "gent", "two"])
@pytest.mark.parametrize("cell_type", ["quad", "tetra", "hexahedron"])
def test_energy_and_derivatives_are_those_of_the_solid(cell_type: str, material: str) -> None:
    """To single precision of the modes; the tangent is that of differences of the forces."""
    equilibrium, random = body("linear", cell_type, material), np.random.default_rng(1)
    solid, free = equilibrium.solid, equilibrium.free
    modes = random.normal(size=(4, *free.shape)) * free
    found = at_all_points(solid, modes)
    a, step = 0.03 * random.normal(size=4), 1e-3 * random.normal(size=4)
    u = torch.from_numpy(np.einsum("m,mni->ni", a, modes)[None])
    nothing, gradient, other = np.zeros(4), np.empty(4), np.empty(4)
    energy = energy_at(found.points, a, nothing, gradient)
    assert energy == pytest.approx(float(solid.energy(u)), rel=1e-5)
    expected = np.einsum("mni,ni->m", modes, solid.internal_forces(u)[0].numpy())
    size = np.abs(expected).max()
    np.testing.assert_allclose(gradient, expected, rtol=0, atol=1e-5 * size)
    of_points = found.forces_of_points(a).sum(axis=1)
    np.testing.assert_allclose(of_points, expected, rtol=0, atol=1e-5 * size)
    energy_at(found.points, a + step, nothing, gradient)
    energy_at(found.points, a - step, nothing, other)
    change = found.tangent(a) @ step
    size = np.abs(change).max()
    np.testing.assert_allclose((gradient - other) / 2, change, rtol=0, atol=2e-3 * size)


def test_points_keep_their_order() -> None:
    """Forces of a point of one material are those of the cubature's point, not of another."""
    equilibrium = body("linear", "quad", "two")
    modes = np.random.default_rng(2).normal(size=(3, *equilibrium.free.shape)) * equilibrium.free
    found, a = at_all_points(equilibrium.solid, modes), np.array([0.02, -0.01, 0.03])
    volumes = equilibrium.solid.volumes.numpy()
    chosen = np.random.default_rng(0).permutation(volumes.size)
    solid, every = equilibrium.solid, found.forces_of_points(a)
    for number in (0, 5, 11):
        cell, point = np.divmod(chosen[number : number + 1], volumes.shape[1])
        corners = modes[:, solid.cells.numpy()[cell]]
        slopes = np.einsum("mqai,qaj->qijm", corners, solid.gradients.numpy()[cell, point])
        part = int(solid.material_of_cells()[cell[0]])
        starts, weights = np.array([0, int(part == 0), 1]), volumes.ravel()[chosen[[number]]]
        alone = forces_of_points(points_of(slopes, weights, solid.laws, starts, 0), a)
        np.testing.assert_allclose(every[:, number], alone[:, 0], rtol=1e-6)
