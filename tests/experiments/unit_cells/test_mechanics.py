"""Mechanics of unit cells: series, least energy, Newton's method, and the material by energies."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.unit_cells.material import found_material
from experiments.unit_cells.mechanics import SolidCell
from experiments.unit_cells.unit_cell import Prediction, UnitCell, scores
from shared_schema import NeoHookean
from tests.surrogate.mechanics.bodies import cells_of

MATERIAL = NeoHookean(young_modulus=3.0, poisson_ratio=0.2, volumetric="quadratic")
CELLS = 12  # along an edge


def with_hole(c11: float, c12: float, c22: float, solution: Prediction | None = None) -> UnitCell:
    """Square from 1 to 2, of triangles, without those in the middle."""
    shape = (CELLS + 1, CELLS + 1)
    x = 1 + np.argwhere(np.ones(shape)) / CELLS
    triangles = cells_of("triangle", shape)
    solid = np.abs(x[triangles].mean(axis=1) - 1.5).max(axis=1) > 0.2
    used, triangles = np.unique(triangles[solid], return_inverse=True)
    nothing = Prediction(np.zeros((len(used), 7)), 0.0)
    return UnitCell(
        x[used], triangles.reshape(-1, 3), np.array([c11, c12, c22]), solution or nothing
    )


def equilibrium(cell: UnitCell) -> Prediction:
    solid, u = SolidCell(cell, MATERIAL), cell.homogeneous
    for _ in range(12):
        u = solid.corrected(u)
    return solid.prediction(u)


def stretched(u11: float, u12: float, u22: float) -> UnitCell:
    """Cell in equilibrium under U."""
    c = np.linalg.matrix_power(np.array([[u11, u12], [u12, u22]]), 2)
    of = float(c[0, 0]), float(c[0, 1]), float(c[1, 1])
    return with_hole(*of, equilibrium(with_hole(*of)))


def test_stretch_is_the_square_root() -> None:
    cell = with_hole(1.25, 0.4, 0.9)
    u = cell.stretch_tensor
    np.testing.assert_allclose(u @ u, [[1.25, 0.4], [0.4, 0.9]], rtol=1e-14)
    assert (np.linalg.eigvalsh(u) > 0).all()


def test_series_is_of_third_order() -> None:
    """Halving the stretch divides the error of the sum by 2⁴, that of the least energy by more."""
    of_sum, of_least_energy = [], []
    for part in (1.0, 0.5):
        cell = stretched(1 + 0.08 * part, 0.03 * part, 1 - 0.05 * part)
        solid, exact = SolidCell(cell, MATERIAL), cell.solution.fields[:, :2]
        of_sum.append(np.abs(cell.homogeneous + sum(solid.terms) - exact).max())
        of_least_energy.append(np.abs(solid.series() - exact).max())
    assert 3.6 < np.log2(of_sum[0] / of_sum[1]) < 4.6
    assert of_least_energy[0] < of_sum[0]


def test_newton_converges_quadratically() -> None:
    cell = stretched(1.1, 0.05, 0.95)
    solid, exact = SolidCell(cell, MATERIAL), cell.solution.fields[:, :2]
    u = solid.series()
    errors = [np.abs(u - exact).max()]
    for _ in range(2):
        u = solid.corrected(u)
        errors.append(np.abs(u - exact).max())
    assert errors[1] < 0.05 * errors[0]
    assert errors[2] < 1e-3 * errors[1]


def test_stress_is_the_derivative_of_the_energy_by_the_stretch() -> None:
    """Hill: the mean of P over the square is ∂W/∂F; here by the symmetric U."""
    h = 1e-4
    cell = stretched(1.1, 0.05, 0.95)
    p11, p12, p22, p21 = (cell.mean(cell.solution.fields[:, k]) for k in (2, 3, 4, 5))
    along = stretched(1.1 + h, 0.05, 0.95).solution.energy
    along -= stretched(1.1 - h, 0.05, 0.95).solution.energy
    assert along / (2 * h) == pytest.approx(p11, rel=1e-6)
    across = stretched(1.1, 0.05 + h, 0.95).solution.energy
    across -= stretched(1.1, 0.05 - h, 0.95).solution.energy
    assert across / (2 * h) == pytest.approx(p12 + p21, rel=1e-6)
    assert p22 < 0 < p11


def test_material_is_found_from_energies() -> None:
    """E, ν and the volumetric term, and that the outer edge moves homogeneously.

    Two energies would be those of a material of either term.
    """
    stretches = (1.1, 0.05, 0.95), (0.95, -0.04, 1.06), (1.15, 0.02, 1.1)
    found = found_material([stretched(*each) for each in stretches])
    assert found is not None
    assert found.material.young_modulus == pytest.approx(3.0, rel=1e-9)
    assert found.material.poisson_ratio == pytest.approx(0.2, rel=1e-9)
    assert found.edge_error < 1e-12


def test_another_edge_is_noticed() -> None:
    cells = [stretched(1.1, 0.05, 0.95), stretched(0.95, -0.04, 1.06), stretched(1.0, 0.1, 1.1)]
    for cell in cells:
        cell.solution.fields[cell.is_outer, 0] *= 1.1
    found = found_material(cells)
    assert found is not None
    assert found.edge_error > 0.02


def test_scores() -> None:
    """Errors of half the largest value at half of the nodes: 0.5 / √2; of the energy 0.5."""
    fields = np.ones((4, 7))
    cell = UnitCell(np.zeros((4, 2)), np.zeros((0, 3), np.int64), np.ones(3), Prediction(fields, 2))
    predicted = fields.copy()
    predicted[:2] += 0.5
    found = scores([cell, cell], [Prediction(predicted, 3.0)] * 2)
    assert found["psi"] == pytest.approx(0.5 / np.sqrt(2))
    assert found["effective_energy"] == 0.5
    assert found["total"] == pytest.approx((7 * 0.5 / np.sqrt(2) + 0.5) / 8)
