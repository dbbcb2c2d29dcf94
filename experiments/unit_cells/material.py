"""The material of unit cells whose solutions are known, found from their energies.

A Neo-Hookean energy is linear in μ and λ: those of least squares over some cells, for each
volumetric term, tell how well such a material explains them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from experiments.unit_cells.mechanics import SolidCell
from experiments.unit_cells.unit_cell import UnitCell
from shared_schema import NeoHookean

TERMS: tuple[Literal["paper", "quadratic"], ...] = ("paper", "quadratic")
SOFT, STIFF = 0.1, 0.4  # Poisson's ratios of the two materials that all are made of


class FoundMaterial(NamedTuple):
    """A material, the largest relative error of its energies, and that of the outer edge.

    The last is the largest distance of the displacement of the outer edge from the homogeneous
    one, over that.
    """

    material: NeoHookean
    energy_error: float
    edge_error: float


def found_material(cells: Sequence[UnitCell]) -> FoundMaterial | None:
    """Find the material of some cells; None if no Neo-Hookean one is near their energies."""
    energies = np.array([cell.solution.energy for cell in cells])
    candidates = []
    for volumetric in TERMS:
        basis = [
            NeoHookean(young_modulus=1.0, poisson_ratio=ratio, volumetric=volumetric)
            for ratio in (SOFT, STIFF)
        ]
        columns = [
            [SolidCell(cell, each).prediction(cell.solution.fields[:, :2]).energy for cell in cells]
            for each in basis
        ]
        matrix = np.array(columns).T / energies[:, None]
        parts = np.linalg.lstsq(matrix, np.ones(len(cells)), rcond=None)[0]
        lam, mu = (
            float(parts @ [getattr(each, name) for each in basis])
            for name in ("lame_lambda", "lame_mu")
        )
        if mu > 0 and lam > -2 * mu / 3:
            ratio = lam / (2 * (lam + mu))
            material = NeoHookean(
                young_modulus=2 * mu * (1 + ratio), poisson_ratio=ratio, volumetric=volumetric
            )
            candidates.append((float(np.abs(matrix @ parts - 1).max()), material))
    edges = [
        np.abs(cell.solution.fields[:, :2] - cell.homogeneous)[cell.is_outer].max()
        / np.abs(cell.homogeneous[cell.is_outer]).max()
        for cell in cells
    ]
    if not candidates:
        return None
    error, material = min(candidates, key=lambda one: one[0])
    return FoundMaterial(material, error, float(max(edges)))
