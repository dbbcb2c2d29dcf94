r"""Equilibrium of a solid under nodal forces: out-of-balance forces and Newton steps.

.. math::
    r(u) = f_{int}(u) - f = \frac{∂Π}{∂u}, \qquad Π(u) = E(u) - f · u, \qquad
    δ(u) = -K(u)^{-1} r(u), \qquad K = \frac{∂f_{int}}{∂u}

at the free degrees of freedom; clamped nodes do not move. Equilibrium is r = 0, and δ is the step
of Newton's method towards it. Where K is not positive definite, δ is computed with K + τ K(0)
instead, with the first :math:`τ = 0.1 · 4^k` that is sufficient, so that Π decreases along δ.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from shared_schema.material import NeoHookean
from surrogate.data.geometry import Geometry
from surrogate.mechanics.band_matrix import BandCholesky, BandLayout
from surrogate.mechanics.solid import Solid

Array = NDArray[np.float64]
FIRST_SHIFT, SHIFT_GROWTH = 0.1, 4.0  # of τ
EPSILON = float(np.finfo(np.float64).eps)
AT_ONCE = 2**23  # entries of bands and cell matrices that are held at once: 64 MB


class Equilibrium:
    """Equilibria of one body, in double precision.

    Displacements (N, n_nodes, d) are in m and forces, of the same shape, in N.

    Parameters
    ----------
    geometry : Geometry
    material : NeoHookean

    Attributes
    ----------
    solid : Solid
    free : array of bool, (n_nodes,)
        Nodes that are not clamped.
    rounding : float
        Bound of the rounding error of Π in J: 10 ε (λ + μ) times the body's volume.
    """

    def __init__(self, geometry: Geometry, material: NeoHookean) -> None:
        body = geometry.coordinates, geometry.cells
        self.solid = Solid(*body, geometry.cell_type, material)
        self.free = ~geometry.clamped
        moduli = material.lame_lambda + material.lame_mu
        self.rounding = 10 * EPSILON * moduli * float(self.solid.volumes.sum())
        self._size = geometry.coordinates.size
        self._layout = BandLayout(*body, geometry.clamped)
        per_sample = len(self._layout.dofs) * (self._layout.width + 1)
        per_sample += self.solid.cells.numel() * self.solid.cells.shape[1] * geometry.dimension**2
        self._at_once = max(1, AT_ONCE // per_sample)

    def inverted(self, u: Array) -> NDArray[np.int64]:
        """Number of inverted cells, (N,); a cell with a NaN counts as well."""
        return self.solid.inverted(torch.from_numpy(u)).numpy()

    def potential(self, u: Array, f: Array) -> Array:
        """Π(u) in J, (N,); +∞ if a cell is inverted."""
        energy = self.solid.energy(torch.from_numpy(u)).numpy()
        potential: Array = np.nan_to_num(energy - (u * f).sum((1, 2)), nan=np.inf)
        return potential

    def out_of_balance(self, u: Array, f: Array) -> Array:
        """r(u) in N, (N, n_nodes, d); zero at clamped nodes."""
        r: Array = self.solid.internal_forces(torch.from_numpy(u)).numpy() - f
        r[:, ~self.free] = 0.0
        return r

    def newton_steps(self, u: Array, r: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Newton steps δ in m, (N, n_nodes, d), at displacements without inverted cells.

        Returns
        -------
        steps : array, (N, n_nodes, d)
            Zero at clamped nodes.
        stable : array of bool, (N,)
            True where K(u) is positive definite.
        """
        steps, stable = np.zeros(u.shape), np.zeros(len(u), dtype=bool)
        right = r.reshape(len(u), self._size)[:, self._layout.dofs]
        for start in range(0, len(u), self._at_once):
            some = slice(start, start + self._at_once)
            for row, band in enumerate(self._bands(u[some]), start):
                factor = BandCholesky.of(band)
                stable[row] = factor is not None
                factor = factor or self._shifted(u[row : row + 1])
                steps[row].flat[self._layout.dofs] = -factor.solve(right[row])
        return steps, stable

    def linear_response(self, f: Array) -> Array:
        """K(0)⁻¹ f in m, (N, n_nodes, d), of a factorisation that is kept."""
        response = np.zeros((len(f), self._size))
        forces = f.reshape(response.shape)[:, self._layout.dofs]
        response[:, self._layout.dofs] = self._undeformed.solve(forces.T).T
        return response.reshape(f.shape)

    @cached_property
    def _undeformed(self) -> BandCholesky:
        rest = np.zeros((1, len(self.free), self._size // len(self.free)))
        factor = BandCholesky.of(self._bands(rest)[0])
        assert factor is not None, "the supports do not hold the body"
        return factor

    def _bands(self, u: Array) -> Array:
        return self._layout.assembled(self.solid.cell_tangents(torch.from_numpy(u)))

    def _shifted(self, u: Array) -> BandCholesky:
        """Factorise K(u) + τ K(0); K(0) alone if no τ is sufficient."""
        tangent, undeformed = self._bands(np.concatenate([u, np.zeros_like(u)]))
        shift = FIRST_SHIFT
        while shift < 1 / EPSILON:
            factor = BandCholesky.of(tangent + shift * undeformed)
            if factor is not None:
                return factor
            shift *= SHIFT_GROWTH
        return self._undeformed
