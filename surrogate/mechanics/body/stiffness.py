r"""Bodies as stiff as is wanted: another Young's modulus than that of the training.

The energy of one homogeneous material is proportional to E, if all its moduli are. Then the
displacement depends on f / E alone:

.. math:: u(f; E) = u\big(f \, E_0 / E; \; E_0\big)

with Young's modulus :math:`E_0` at rest of the run's material. Stresses, reactions and energies are
those of :math:`f E_0 / E` times :math:`E / E_0`.

Zones of their own moduli are another body. What follows from the body alone, as a load series, is
made anew for it; what a network has learned is not.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from shared_schema.common.errors import InputError
from shared_schema.materials import Materials, YoungPoisson

LARGEST = 1e30  # Pa


def modulus_at_rest(material: Materials) -> float:
    """Young's modulus E₀ at rest in Pa; InputError if the body is of several materials."""
    if isinstance(material, tuple):
        groups = ", ".join(f"'{each.group}'" for each in material)
        raise InputError(f"young_modulus: expected that of one of the zones {groups} (GROUP=E)")
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
    require_modulus(young_modulus)
    return young_modulus / modulus_at_rest(material)


def require_modulus(young_modulus: float) -> None:
    """Raise InputError unless a modulus in Pa is positive and finite."""
    if not 0 < young_modulus <= LARGEST:
        raise InputError(f"young_modulus: {young_modulus}, expected more than 0 Pa, and finite")


def case_of_moduli(
    case: Mapping[str, Any], material: Materials, moduli: Mapping[str, float]
) -> dict[str, Any]:
    """The configuration of a case, of these materials, with other moduli in Pa of some zones.

    Raises
    ------
    InputError
        If the body is of one material, there is no such zone, or its material has no modulus; or a
        modulus is not positive and finite.
    """
    if not isinstance(material, tuple):
        raise InputError("young_modulus: the body is of one material, expected one number")
    groups = [each.group for each in material]
    for group, modulus in moduli.items():
        if group not in groups:
            known = ", ".join(f"'{each}'" for each in groups)
            raise InputError(f"young_modulus: zone '{group}', expected one of {known}")
        if not isinstance(material[groups.index(group)], YoungPoisson):
            raise InputError(f"young_modulus: the material of zone '{group}' has none")
        require_modulus(modulus)
    changed = [
        {**content, "young_modulus": float(moduli[content["group"]])}
        if content["group"] in moduli
        else content
        for content in case["material"]
    ]
    return {**case, "material": changed}
