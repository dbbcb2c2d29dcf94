r"""The softest modes of a body, in which it buckles: how stiff they are at a deformed state.

.. math::
    θ_i = \frac{s_i · K(u) \, s_i}{φ_i · K(0) \, φ_i}, \qquad s_i = T φ_i

with the modes φ of the undeformed body, carried to the state
(`surrogate.descent.carried_compliance`). It is a Rayleigh quotient of P K(u), whose eigenvalues are
1 where P is exact: a small θ says that a direction made with P is too short along s, a negative one
that the state is not stable. Both hardly ever happen, and products with K(u) cost a residual each.
So the stresses are looked at first. They are what softens a mode,

.. math:: θ_i ≈ 1 + \frac{1}{φ_i · K(0) \, φ_i} \sum_q w_q \, S_q : (H_q^T H_q), \qquad
          H = F \, ∇φ_i

with the second Piola–Kirchhoff stress S.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from surrogate.descent.cell_fields import CellFields, Values, jacobian, product
from surrogate.mechanics.out_of_balance import Equilibrium

Array = NDArray[np.float64]
MODES, BESIDE = 3, 3  # that are kept, and others that are iterated with them
ITERATIONS = 8


class SoftModes:
    """The softest modes of the undeformed body.

    Parameters
    ----------
    equilibrium : Equilibrium
    fields : CellFields or None
        In double precision.
    respond : callable
        Forces (N, n_points, d) in N to linear responses in m.

    Attributes
    ----------
    modes : array, (n_modes, n_points, d)
    energies : array, (n_modes,)
        Twice their energies, φ · K(0) φ.
    """

    def __init__(
        self, equilibrium: Equilibrium, fields: CellFields | None, respond: Callable[[Array], Array]
    ) -> None:
        shape = equilibrium.free.shape
        count = min(MODES + BESIDE, len(equilibrium.layout.dofs))
        x = np.random.default_rng(0).normal(size=(count, *shape)) * equilibrium.free
        for _ in range(ITERATIONS):  # subspace iteration
            rows = respond(x).reshape(count, -1)
            x = np.linalg.qr(rows.T)[0].T.reshape(x.shape)
        response = respond(x).reshape(count, -1)
        softness, turn = np.linalg.eigh(response @ x.reshape(count, -1).T)
        order = np.argsort(-softness)[:MODES]
        forces = turn.T[order] @ x.reshape(count, -1)
        modes = turn.T[order] @ response
        self.modes: Array = modes.reshape(-1, *shape)
        self.energies: Array = (modes * forces).sum(axis=1)
        self.softening = None if fields is None else Softening(fields, self.modes, self.energies)


class Softening:
    """What the stresses of a state do to some modes.

    Parameters
    ----------
    fields : CellFields
        At whose points stresses and deformation gradients are given.
    modes : array, (n_modes, n_points, d)
    energies : array, (n_modes,)
    """

    def __init__(self, fields: CellFields, modes: Array, energies: Array) -> None:
        self.fields, self.energies = fields, energies
        self._slopes = [fields.slopes(mode) for mode in modes]

    def quotients(self, f: Values, piola: Values) -> Array:
        """θ by the stresses alone, (n_modes,), of F and P in Pa: (d, d, n) each."""
        j, cofactors = jacobian(f)
        weighted = product(cofactors.swapaxes(0, 1), piola) * (self.fields.weights / j)  # w S
        found = []
        for slopes, energy in zip(self._slopes, self.energies, strict=True):
            h = product(f, slopes)
            found.append(1 + float(np.vdot(product(h, weighted), h)) / energy)
        return np.array(found)
