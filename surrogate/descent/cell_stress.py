r"""Stresses of one load at the quadrature points of a body, whose sum are the internal forces.

Those of a Neo-Hookean solid are

.. math:: P = μ F + s(J) \, \mathrm{cof} F, \qquad s(J) = g (J - 1) - μ + d \, (1 - 1 / J)

with the factors μ, g and d of `surrogate.series.stress_series.Factors`. Where the volume of a cell
changes as a whole (`surrogate.mechanics.solids.mean_dilation`), with :math:`r = (θ / J)^{1/n}` in n
dimensions, the derivative of the energy by F at the points is

.. math::
    P = μ r^2 F + \left( π - \frac{μ r^2}{n} \frac{F : F}{J} \right) \mathrm{cof} F, \qquad
    π = s(θ) + \frac{1}{V} \sum_q w_q \frac{μ r_q^2}{n} \frac{F_q : F_q}{θ}.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from shared_schema.materials import NeoHookean
from surrogate.descent.cell_fields import jacobian
from surrogate.mechanics.energy.law import law_of
from surrogate.mechanics.solids.mean_dilation import MeanDilationSolid
from surrogate.mechanics.solids.solid import Points, Solid, stress_at
from surrogate.series.stress_series import Factors

Array = NDArray[np.float64]


class CellStress:
    """P of a solid at F.

    Parameters
    ----------
    solid : Solid
        One for which `is_known` holds.
    """

    def __init__(self, solid: Solid) -> None:
        self._solid, self._volumes = solid, solid.volumes.numpy()
        self._factors = factors_of(solid)

    @staticmethod
    def is_known(solid: Solid) -> bool:
        """Whether the forces of a solid are a sum of stresses at points that are known here."""
        if isinstance(solid, MeanDilationSolid):
            return factors_of(solid) is not None
        return type(solid) is Solid

    def __call__(self, f: Array) -> Array | None:
        """P in Pa of F at the points of the cells, (d, d, n) each; None if J is not positive.

        The points may also be one of every cell.
        """
        j, cofactors = jacobian(f)
        if not bool((j > 0).all()):
            return None
        solid, cells = self._solid, len(self._volumes)
        if self._factors is None:
            of_cells = torch.from_numpy(f).reshape(*f.shape[:2], cells, 1, -1)
            laws = [law_of(material, len(f)) for material in solid.materials]
            return (
                solid.by_law(stress_at, Points(of_cells, fibres=solid.fibres), laws)
                .flatten(2)
                .numpy()
            )
        if isinstance(solid, MeanDilationSolid):
            return self._of_mean_dilation(f, j, cofactors)
        mu, growth, decay = np.repeat(self._factors, len(j) // cells, axis=1)
        return np.asarray(mu * f + factor(j, mu, growth, decay) * cofactors)

    def _of_mean_dilation(self, f: Array, j: Array, cofactors: Array) -> Array:
        assert self._factors is not None
        mu, growth, decay = self._factors
        of_cells, whole, n = (len(mu), -1), self._volumes.sum(axis=1), len(f)
        dilation = (self._volumes * j.reshape(of_cells)).sum(axis=1) / whole
        ratio = (dilation[:, None] / j.reshape(of_cells)) ** (2 / n)
        shear = mu[:, None] * ratio  # μ r²
        squares = shear * np.square(f).sum(axis=(0, 1)).reshape(of_cells) / n
        mean = (self._volumes * squares).sum(axis=1) / (whole * dilation)
        pressure = factor(dilation, mu, growth, decay) + mean
        along = pressure[:, None] - squares / j.reshape(of_cells)
        return np.asarray(shear.ravel() * f + along.ravel() * cofactors)


def factor(j: Array, mu: Array, growth: Array, decay: Array) -> Array:
    """Return s in Pa."""
    return growth * (j - 1) - mu + decay * (1 - 1 / j)


def factors_of(solid: Solid) -> Array | None:
    """Factors of the stress in the cells, (3, n_cells); None if a material is not Neo-Hookean."""
    materials = [material for material in solid.materials if isinstance(material, NeoHookean)]
    if len(materials) < len(solid.materials):
        return None
    return np.array([Factors.of(each) for each in materials]).T[:, solid.material_of_cells()]
