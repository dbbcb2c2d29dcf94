r"""Stress and stiffness of the undeformed body, from the derivatives of its energy by invariants.

With the invariants :math:`x_k` of `shared_schema.materials.signature`,
:math:`C = I + 2 E` and :math:`ψ_k = ∂W/∂x_k` at rest, stress and stiffness are

.. math::
    S[H] = \sum_k ψ_k \, x_k'[H], \qquad
    \mathbb{C}[H, H] = \sum_{kl} ψ_{kl} \, x_k'[H] \, x_l'[H] + \sum_k ψ_k \, x_k''[H, H],

and the derivatives of the invariants by E along a symmetric H are

.. math::
    I_1' = 2 \operatorname{tr} H, \qquad I_2' = 4 \operatorname{tr} H, \qquad
    J' = \operatorname{tr} H, \qquad I_4' = 2 ε, \qquad K_4' = 2 (\operatorname{tr} H - ε), \\
    I_2'' = 4 (\operatorname{tr} H)^2 - 4 H:H, \qquad
    J'' = (\operatorname{tr} H)^2 - 2 H:H, \\
    K_4'' = 8 |H a|^2 - 8 ε \operatorname{tr} H + 4 (\operatorname{tr} H)^2 - 4 H:H, \qquad
    ε = a \cdot H a .

For an isotropic energy :math:`\mathbb{C}` has the Lamé parameters
:math:`μ = 2 (ψ_1 + ψ_2)`, without stress. All families of fibres are taken to lie along one
direction a, in which they are stiffest together. Marsden and Hughes, Mathematical Foundations of
Elasticity (1983), sections 3.2 and 4.1.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shared_schema.materials.jet import JETS, Jet
from shared_schema.materials.signature import FibreInvariants, Functions, Invariants, Scalar

Array = NDArray[np.float64]
Energy = Callable[[Invariants, Functions], Scalar]
STRESS_FREE = 1e-9  # largest stress at rest, over the stiffness
SMALLEST = 1e-12  # least eigenvalue of the stiffness, scaled to a diagonal of ones; rounding: 1e-15


class AtRest(NamedTuple):
    """Stress and stiffness of the undeformed body in Pa.

    Attributes
    ----------
    stress : array, (6,)
        On the orthonormal basis of symmetric tensors of `_basis`: five that preserve the volume,
        and I/√3.
    stiffness : array, (6, 6)
        ℂ on the same basis.
    """

    stress: Array
    stiffness: Array

    @property
    def shear_modulus(self) -> float:
        """μ in Pa, of the stiffest strain that preserves the volume: 2 μ is its stiffness."""
        return float(np.linalg.eigvalsh(self.stiffness[:5, :5])[-1]) / 2

    @property
    def bulk_modulus(self) -> float:
        """K = I:ℂ:I / 9 in Pa."""
        return float(self.stiffness[5, 5]) / 3

    def problem(self) -> str | None:
        """Say why this is no solid at rest, if it is none."""
        if not (np.isfinite(self.stress).all() and np.isfinite(self.stiffness).all()):
            return "the energy has no value, or no stiffness, in the undeformed body"
        stress, scale = np.abs(self.stress).max(), np.abs(self.stiffness).max()
        if stress > STRESS_FREE * scale:
            return f"the undeformed body is under a stress of {stress:g} Pa, expected none"
        shear = float(np.linalg.eigvalsh(self.stiffness[:5, :5])[0]) / 2
        for name, modulus in (("shear", shear), ("bulk", self.bulk_modulus)):
            if not modulus > 0:
                return f"the {name} modulus at rest is {modulus:g} Pa, expected above 0"
        root = np.sqrt(np.diag(self.stiffness))
        least = float(np.linalg.eigvalsh(self.stiffness / np.outer(root, root))[0])
        if not least > SMALLEST:
            return "a small strain costs no energy, expected a positive definite stiffness at rest"
        return None


def at_rest(energy: Energy, families: int) -> AtRest:
    """Derive stress and stiffness at rest from an energy of some families of fibres.

    Raises
    ------
    ArithmeticError, ValueError
        If the energy has no value there.
    """
    i1, i2, j, *rest = Jet.variables(3.0, 3.0, 1.0, *(1.0,) * (2 * families))
    fibres = tuple(FibreInvariants(*rest[2 * k : 2 * k + 2]) for k in range(families))
    w = energy(Invariants(i1, i2, j, fibres), JETS)
    psi = w if isinstance(w, Jet) else i1.constant(w)
    first, second = _derivatives(families)
    stiffness = first.T @ psi.hessian @ first + np.tensordot(psi.gradient, second, 1)
    return AtRest(psi.gradient @ first, (stiffness + stiffness.T) / 2)


def _basis() -> Array:
    """Orthonormal symmetric tensors, (6, 3, 3): five without a trace, then I/√3."""
    pairs = [np.diag([1.0, -1.0, 0.0]), np.diag([1.0, 1.0, -2.0])]
    for i, k in ((0, 1), (0, 2), (1, 2)):
        shear = np.zeros((3, 3))
        shear[i, k] = shear[k, i] = 1.0
        pairs.append(shear)
    return np.stack([h / np.linalg.norm(h) for h in [*pairs, np.eye(3)]])


@cache
def _derivatives(families: int) -> tuple[Array, Array]:
    """x_k' and x_k'' on the basis: (n_invariants, 6) and (n_invariants, 6, 6)."""
    basis = _basis()
    trace = np.trace(basis, axis1=1, axis2=2)
    trace[:5] = 0.0
    traces, squares, nothing = np.outer(trace, trace), np.eye(6), np.zeros((6, 6))
    along = basis[:, 0, 0]  # ε for a = (1, 0, 0)
    across = basis[:, 0] @ basis[:, 0].T
    mixed = np.outer(along, trace)
    area = 8 * across - 4 * (mixed + mixed.T) + 4 * traces - 4 * squares
    first = [2 * trace, 4 * trace, trace] + [2 * along, 2 * (trace - along)] * families
    second = [nothing, 4 * (traces - squares), traces - 2 * squares] + [nothing, area] * families
    return np.stack(first), np.stack(second)
