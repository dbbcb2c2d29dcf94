"""Compiled loops on any material and element: those of PyTorch, and derivatives by differences."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from surrogate.mechanics.compiled import cells
from surrogate.mechanics.energy.law import DILATION
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.solids.deformation import Deformation, cofactors, determinant
from surrogate.mechanics.solids.mixed_elements import TaylorHoodSolid
from tests.surrogate.mechanics.series.test_body_series import ELEMENTS, MATERIALS, body

BODIES = [
    *((element, each, "two") for element, some in ELEMENTS.items() for each in some),
    *(("linear", "hexahedron", material) for material in MATERIALS),
    *(("incompressible", "quad", material) for material in MATERIALS),
]


def displacement(equilibrium: Equilibrium, size: float = 0.02) -> np.ndarray:
    """Of two states, at random."""
    shape = 2, *equilibrium.free.shape
    return size * np.random.default_rng(3).normal(size=shape)


@pytest.mark.parametrize(("element", "cell_type", "material"), BODIES)
def test_forces_and_tangents(element: str, cell_type: str, material: str) -> None:
    equilibrium = body(element, cell_type, material)
    solid, u = equilibrium.solid, displacement(equilibrium)
    expected = solid.internal_forces(torch.from_numpy(u)).numpy()
    found = solid.compiled.internal_forces(u)
    assert np.abs(expected).max() > 1
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    assert solid.compiled.internal_forces(u[:0]).shape == (0, *u.shape[1:])
    if isinstance(solid, TaylorHoodSolid):
        return  # whose tangents are those of θ and p as well: `test_taylor_hood`
    h = solid.slopes(torch.from_numpy(u[::-1].copy()))
    f = solid.deformation_gradient(torch.from_numpy(u))
    by_pressure = torch.zeros_like(f)
    if solid.projects:
        dilation, slope = solid.projected(determinant(f)), torch.zeros_like(f[0, 0])
        fibres = solid.fibres
        for number, law in enumerate(solid.laws):
            some = solid.material_of_cells() == number
            of_law = None if fibres is None else fibres[: law.families, :, some]
            state = Deformation(f[:, :, some], dilation[some], of_law)
            slope[some] = law.stress(state.measures)[DILATION]
        by_pressure = solid.projected(slope) * (cofactors(f + h / 2) - cofactors(f - h / 2))
    whole = solid.path(torch.from_numpy(u)).along(h[:, :, None])[:, :, 0]
    for relaxed, change in ((False, whole), (True, whole - by_pressure)):
        products = solid.forces_of(change).numpy()
        tangents = solid.compiled.cell_tangents(u, relaxed).numpy()
        numbers = equilibrium.geometry.cells if equilibrium.points is None else solid.cells.numpy()
        local = u[::-1, numbers].reshape(*tangents.shape[:3])
        of_cells = np.einsum("ncij,ncj->nci", tangents, local).reshape(2, *numbers.shape, -1)
        sums = np.zeros_like(u)
        for row, part in zip(sums, of_cells, strict=True):
            np.add.at(row, numbers, part)
        np.testing.assert_allclose(sums, products, rtol=0, atol=1e-12 * np.abs(products).max())


@pytest.mark.parametrize("element", ["linear", "incompressible"])
@pytest.mark.parametrize("material", ["yeoh", "guccione", "holzapfel_gasser_ogden"])
def test_tangents_are_derivatives(element: str, material: str) -> None:
    """By central differences along a displacement at random."""
    equilibrium = body(element, "quad", material)
    u, change = displacement(equilibrium)
    solid, step = equilibrium.solid.compiled, 1e-5
    beside = solid.internal_forces(np.stack([u + step * change, u - step * change]))
    expected = (beside[0] - beside[1]) / (2 * step)
    numbers = equilibrium.geometry.cells
    local = change[numbers].reshape(len(numbers), -1)
    products = np.einsum("cij,cj->ci", solid.cell_tangents(u[None])[0].numpy(), local)
    found = np.zeros_like(u)
    np.add.at(found, numbers, products.reshape(*numbers.shape, -1))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize(("element", "cell_type"), [(e, t) for e in ELEMENTS for t in ELEMENTS[e]])
def test_inverted_cells(element: str, cell_type: str) -> None:
    """Of large displacements; a mirrored body is inverted as a whole, one of NaN as well."""
    equilibrium = body(element, cell_type, "two")
    solid, u = equilibrium.solid, displacement(equilibrium, 0.1)
    u[1] = -2 * equilibrium.geometry.coordinates * ([1.0] + [0.0] * (u.shape[2] - 1))
    u = np.concatenate([u, np.full_like(u[:1], np.nan)])
    expected = solid.inverted(torch.from_numpy(u)).numpy()
    np.testing.assert_array_equal(solid.compiled.inverted(u), expected)
    assert expected[1] == expected[2] == len(solid.cells)


@pytest.mark.parametrize("element", ELEMENTS)
def test_rows_of_a_large_body(element: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Several blocks of cells of two materials, with several points each, are the same."""
    equilibrium = body(element, "triangle" if element == "quadratic" else "quad", "two")
    solid, u = equilibrium.solid, displacement(equilibrium)
    small = solid.compiled
    assert small.cells.gradients.shape[1] == 1
    monkeypatch.setattr(cells, "ROW", 8)
    del solid.compiled
    assert len(solid.compiled.cells.numbers) > 2
    forces = solid.compiled.internal_forces(u), small.internal_forces(u)
    np.testing.assert_allclose(*forces, rtol=0, atol=1e-12 * np.abs(forces[1]).max())
    tangents = solid.compiled.cell_tangents(u), small.cell_tangents(u)
    np.testing.assert_allclose(*tangents, rtol=0, atol=1e-12 * float(tangents[1].abs().max()))
