r"""What every strain energy must be: unchanged by a rotation, and of positive stiffness at rest.

With the orthonormal basis :math:`S_k` of symmetric tensors (Mandel) and
:math:`F(a) = I + \sum_k a_k S_k`, the elasticity tensor of the undeformed body is

.. math:: \mathbb{C}_{kl} = \frac{\partial^2 W}{\partial a_k \, \partial a_l} \Big|_{a = 0},

which has to be positive definite, so that every small strain costs energy. A rotation Q of the
whole body must not: :math:`W(Q F) = W(F)`. See Marsden and Hughes, Mathematical Foundations of
Elasticity (1983), sections 3.2 and 4.1. The shipped materials meet both by the bounds of their
keys; a user's own one is looked at here.
"""

from __future__ import annotations

import numpy as np
import ufl
from numpy.typing import NDArray
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives

from datagen.materials.own_energy import own_energy
from datagen.materials.own_material import OwnMaterial
from shared_schema.common.errors import InputError

Array = NDArray[np.float64]
SMALLEST = 1e-12  # least eigenvalue of the stiffness at rest, over the largest; rounding is 1e-15
UNCHANGED = 1e-8  # change of the energy by a rotation, over the energy
STRAIN = 0.05  # of the deformations that are turned
STRESS_FREE = 1e-9  # largest force in the undeformed body, over stiffness times size


def require_elastic(material: OwnMaterial, dimension: int) -> None:
    """Refuse an energy without stiffness at rest, or that a rotation of the body changes.

    Parameters
    ----------
    material : OwnMaterial
    dimension : int
        2 looks at strains and rotations in the plane alone, as plane strain does.

    Raises
    ------
    InputError
        If the energy is one of these; the message has what was found.
    """
    try:
        stiffness = stiffness_at_rest(material, dimension)
    except (ArithmeticError, ValueError):  # a logarithm of 0, say; the forces at rest then are NaN
        return
    if not np.isfinite(stiffness).all():
        return
    eigenvalues = np.linalg.eigvalsh(stiffness)
    if not eigenvalues[0] > SMALLEST * eigenvalues[-1]:
        raise InputError(
            f"model '{material.model}': the stiffness at rest has the eigenvalue "
            f"{eigenvalues[0]:.3g} Pa, expected all above 0 (a strain from rest costs energy)"
        )
    before, after = _turned(material, dimension)
    least = eigenvalues[-1] * STRAIN**2  # of the energy of such a strain
    changed = np.abs(after - before) > UNCHANGED * np.maximum(np.abs(before), least)
    if changed.any():
        number = int(changed.argmax())
        raise InputError(
            f"model '{material.model}': a rotation of the deformed body changes its energy from "
            f"{before[number]:.6g} to {after[number]:.6g} J/m³, expected W(QF) = W(F)"
        )


def require_no_stress(forces: Array, stiffness: float, coordinates: Array) -> None:
    """Raise InputError if forces act in the undeformed body.

    Parameters
    ----------
    forces : array, (n_nodes, d)
        In N.
    stiffness : float
        Largest sum of a row of the tangent at rest, in N/m.
    coordinates : array, (n_nodes, d)
        In m.
    """
    scale = stiffness * float(np.ptp(coordinates, axis=0).max())
    if not np.abs(forces).max() <= STRESS_FREE * scale:  # true for NaN as well
        raise InputError(
            "key 'material': the energy gives forces of "
            f"{np.abs(forces).max():g} N in the undeformed body, expected none"
        )


def stiffness_at_rest(material: OwnMaterial, dimension: int) -> Array:
    """Elasticity tensor of the undeformed body by symbolic differentiation, in Pa.

    Returns
    -------
    array, (6, 6), or (3, 3) in the plane
        On the orthonormal basis of symmetric tensors: normal strains, then √2 times shear strains.
    """
    basis = _symmetric(dimension)
    count = len(basis)
    strain = ufl.variable(ufl.as_vector([0.0] * count))
    entries = [
        [
            float(i == j) + sum(float(basis[k, i, j]) * strain[k] for k in range(count))
            for j in range(3)
        ]
        for i in range(3)
    ]
    energy = own_energy(ufl.as_tensor(entries), material)
    hessian = ufl.diff(ufl.diff(energy, strain), strain)
    plain = apply_derivatives(apply_algebra_lowering(hessian))
    result = np.zeros((count, count))
    for k, m in zip(*np.triu_indices(count), strict=True):
        result[k, m] = result[m, k] = float(plain[int(k), int(m)](()))
    return result


def _symmetric(dimension: int) -> Array:
    """Orthonormal basis of the symmetric tensors whose strains are in the first d axes."""
    pairs = [(i, i) for i in range(dimension)]
    pairs += [(i, j) for i in range(dimension) for j in range(i + 1, dimension)]
    basis = np.zeros((len(pairs), 3, 3))
    for tensor, (i, j) in zip(basis, pairs, strict=True):
        tensor[i, j] += 0.5
        tensor[j, i] += 0.5
        tensor /= np.linalg.norm(tensor)
    return basis


def _turned(material: OwnMaterial, dimension: int) -> tuple[Array, Array]:
    """Energies of some deformations, and of the same after a rotation; NaN if it has no value."""
    random = np.random.default_rng(0)
    before, after = np.empty(4), np.empty(4)
    for number in range(4):
        f, q = np.eye(3), np.eye(3)
        plane = (slice(dimension), slice(dimension))
        f[plane] += STRAIN * random.uniform(-1, 1, (dimension, dimension))
        q[plane] = np.linalg.qr(random.normal(size=(dimension, dimension)))[0]
        q[:, 0] *= np.linalg.det(q)
        before[number], after[number] = _value(material, f), _value(material, q @ f)
    return before, after


def _value(material: OwnMaterial, f: Array) -> float:
    try:
        return float(own_energy(ufl.as_tensor(f.tolist()), material)(()))
    except (ArithmeticError, ValueError):
        return np.nan
