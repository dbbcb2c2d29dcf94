r"""The compliance of the undeformed body, carried to a deformed state.

The tangent K(u) of a body that is bent far is not like K(0), since its parts are turned. A change
of displacement y of the undeformed body becomes one of the deformed body whose gradient is, as
nearly as one can be, that of y seen from the turned and stretched material, :math:`F \, ∇y`:

.. math::
    T y = \arg\min_z \sum_q w_q μ_q \, |∇z - F_q ∇y|^2
        = L^{-1} \sum_q w_q μ_q \, (F_q ∇y) \, ∇N, \qquad
    P = T \, K(0)^{-1} T^T \approx K(u)^{-1}

with the Laplacian :math:`L_{ab} = \sum_q w_q μ_q \, ∇N_a · ∇N_b` of every component at the nodes
where it is free. Where F is a rotation everywhere, T is this rotation, and P is exact
for a body whose supports turn with it; at rest T = 1. P is symmetric and positive definite. It
costs a solve with the factor of K(0), which is kept, and two with that of L, whose band is narrower
by the number of components.

Turning *gradients* is better than turning the displacements of nodes by their rotations R: the
modes of a slender body that are soft at rest remain soft, whereas R y of a bending mode y stretches
a bent body.

The same projection makes a good first state of the linear response :math:`u_1 = K(0)^{-1} f` under
large loads. Its strain e and rotation w, the symmetric and the skew part of :math:`∇u_1`, are taken
apart and composed again as finite ones:

.. math:: ∇u ≈ \exp(w) (I + e) - I.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from surrogate.descent.cell_fields import CellFields, Values, product
from surrogate.mechanics.compliance import in_single_precision
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.mechanics.stiffness_layout import stiffness_layout

Array = NDArray[np.float64]
LARGE = 4000  # degrees of freedom from which on single precision saves time


class CarriedCompliance:
    """P of one body, for any state.

    Parameters
    ----------
    equilibrium : Equilibrium
        Its elements, supports and factor of K(0) are used; all fields are at its points.
    """

    def __init__(self, equilibrium: Equilibrium) -> None:
        solid, layout = equilibrium.solid, equilibrium.layout
        large = len(layout.dofs) > LARGE
        self._free, self._dofs, factor = equilibrium.free, layout.dofs, equilibrium.undeformed
        self._factor = in_single_precision(factor, len(layout.dofs)) if large else factor
        gradients, volumes = solid.gradients.numpy(), solid.volumes.numpy()
        moduli = [material.lame_mu for material in solid.materials]
        parts = equilibrium.geometry.parts if len(moduli) > 1 else None
        of_cells = np.array(moduli)[np.zeros(len(volumes), dtype=int) if parts is None else parts]
        weights = volumes * of_cells[:, None]
        self._fields = CellFields(equilibrium, weights, np.float32 if large else np.float64)
        metric = np.einsum("cq,cqaj,cqbj->cab", weights, gradients, gradients)
        mesh, self._laplacians = (equilibrium.geometry.coordinates, equilibrium.geometry.cells), []
        alike, number = np.unique(self._free, axis=1, return_inverse=True)
        for kind, free in enumerate(alike.T):
            scalar = stiffness_layout(*mesh, ~free[:, None])
            found = scalar.factor(scalar.assembled(torch.from_numpy(metric[None]))[0])
            assert found is not None  # a component that is free everywhere makes K(0) singular
            components = np.flatnonzero(number.ravel() == kind)
            places = scalar.dofs[:, None], components
            self._laplacians.append(
                (places, in_single_precision(found, len(scalar.dofs)) if large else found)
            )

    def at(self, u: Array) -> Callable[[Array], Array]:
        """P of a state (n_points, d) in m: forces in N to displacements in m, (n_points, d)."""
        return partial(self._carried, self._fields.deformation_gradient(u))

    def turned(self, u: Array, y: Array) -> Array:
        """T y at a state u, (n_points, d) in m each."""
        f, fields = self._fields.deformation_gradient(u), self._fields
        return self._projected(product(f, fields.slopes(y))).astype(np.float64)

    def warped(self, u: Array) -> Array:
        """The state of finite rotations next to a linear response: (n_points, d) in m → same."""
        h = self._fields.slopes(u)
        stretch, turn = (h + h.swapaxes(0, 1)) / 2, (h - h.swapaxes(0, 1)) / 2
        for i in range(len(h)):
            stretch[i, i] += 1
        slopes = product(exponential(turn), stretch)
        for i in range(len(h)):
            slopes[i, i] -= 1
        return self._projected(slopes).astype(np.float64)

    def _carried(self, f: Values, force: Array) -> Array:
        """T K(0)⁻¹ Tᵀ r."""
        unit = float(np.abs(force).max())
        if not 0 < unit < np.inf:
            return np.zeros_like(force) * unit
        fields = self._fields
        s = self._poisson((force / unit).astype(fields.dtype))
        back = fields.forces(product(f.swapaxes(0, 1), fields.slopes(s)))
        y = np.zeros(back.size, back.dtype)
        y[self._dofs] = self._factor.solve(back.ravel()[self._dofs])
        carried = self._projected(product(f, fields.slopes(y.reshape(back.shape))))
        return carried.astype(np.float64) * unit

    def _projected(self, slopes: Values) -> Values:
        """The displacement whose gradient is next to a given one: (d, d, n) → (n_points, d)."""
        return self._poisson(self._fields.forces(slopes))

    def _poisson(self, right: Values) -> Values:
        """L⁻¹ of every component: (n_points, d) → same, zero where it is held."""
        found = np.zeros_like(right)
        for places, factor in self._laplacians:
            found[places] = factor.solve(right[places])
        return found


def exponential(w: Values) -> Values:
    """Rotation matrices exp(w) of skew ones, (d, d, n) → same: Rodrigues' formula."""
    angle = np.sqrt((w * w).sum((0, 1)) / 2)
    half = np.sinc(angle / (2 * np.pi))
    found = np.sinc(angle / np.pi) * w + half**2 / 2 * product(w, w)
    for i in range(len(w)):
        found[i, i] += 1
    return found.astype(w.dtype)
