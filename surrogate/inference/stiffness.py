r"""Bodies as stiff as is wanted: another Young's modulus than that of the training.

The energy of one homogeneous material is proportional to E, if all its moduli are. Then the
displacement depends on f / E alone:

.. math:: u(f; E) = u\big(f \, E_0 / E; \; E_0\big)

with Young's modulus :math:`E_0` at rest of the run's material. Stresses, reactions and energies are
those of :math:`f E_0 / E` times :math:`E / E_0`.
"""

from __future__ import annotations

from dataclasses import replace

from shared_schema.common.errors import InputError
from shared_schema.material import Materials
from surrogate.inference.solution import Solution

OF_STRAIN = ("deformation_gradient", "jacobian")  # no stresses
LARGEST = 1e30  # Pa


def modulus_at_rest(material: Materials) -> float:
    """Young's modulus E₀ at rest in Pa; InputError if the body is of several materials."""
    if isinstance(material, tuple):
        raise InputError("young_modulus: expected a body of one material, this has several")
    lam, mu = material.lame_lambda, material.lame_mu
    return mu * (3 * lam + 2 * mu) / (lam + mu)


def stiffness_factor(material: Materials, young_modulus: float | None) -> float:
    """Return E / E₀; 1 if E is None.

    Raises
    ------
    InputError
        If E is not positive and finite, or the body is of several materials.
    """
    if young_modulus is None:
        return 1.0
    if not 0 < young_modulus <= LARGEST:
        raise InputError(f"young_modulus: {young_modulus}, expected more than 0 Pa, and finite")
    return young_modulus / modulus_at_rest(material)


def stiffened(solution: Solution, factor: float) -> Solution:
    """The solution of a body that is stiffer by a factor, from that of forces divided by it."""
    contact, correction = solution.contact, solution.correction
    if contact is not None:
        contact = replace(contact, force=contact.force * factor)
    if correction is not None:
        correction = replace(correction, residual_norm=correction.residual_norm * factor)
    return replace(
        solution,
        force=solution.force * factor,
        stresses={
            name: values if name in OF_STRAIN else values * factor
            for name, values in solution.stresses.items()
        },
        reaction=None if solution.reaction is None else solution.reaction * factor,
        grips=None if solution.grips is None else solution.grips * factor,
        contact=contact,
        correction=correction,
    )
