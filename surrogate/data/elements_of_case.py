"""Elements that a body is solved with, as far as the learner knows them.

The learner assembles linear elements. Certificates and corrections are statements about the very
equations that made the data, so they are refused for a body of other elements. The linear response
K⁻¹f in a network's input only has to resemble the body's: it is then that of linear elements on the
same nodes, with a Poisson's ratio of at most 0.4, for which they hardly lock; the network learns
the difference.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from shared_schema.common.errors import InputError
from shared_schema.material import Materials, RubberLike, ShippedMaterial, ratio_at_rest

LARGEST_RATIO = 0.4  # of Poisson, for linear elements that stand for others


def element_of(case: Mapping[str, Any]) -> str:
    """Element that a case configuration names."""
    return str(case.get("element", "linear"))


def require_linear_elements(case: Mapping[str, Any]) -> None:
    """Raise InputError unless a case has linear elements, whose equilibria the learner computes."""
    element = element_of(case)
    if element != "linear":
        raise InputError(
            f"key 'element' of the run's case = '{element}': certificates, corrections, bounds, "
            "stresses and load paths are for linear elements only; `datagen solve --start` "
            "corrects with others"
        )


def material_of_response(material: Materials, case: Mapping[str, Any]) -> Materials:
    """Material of the linear elements whose response stands for that of the case's elements."""
    if element_of(case) == "linear":
        return material
    if isinstance(material, tuple):
        return tuple(_compressible(each) for each in material)
    return _compressible(material)


def _compressible(material: ShippedMaterial) -> ShippedMaterial:
    """Material of the same shear modulus (of Young's, where named), with a ratio of at most 0.4."""
    if ratio_at_rest(material) <= LARGEST_RATIO:
        return material
    if isinstance(material, RubberLike):
        bulk = 2 * (1 + LARGEST_RATIO) / (3 * (1 - 2 * LARGEST_RATIO)) * material.lame_mu
        return material.model_copy(update={"bulk_modulus": bulk})
    return material.model_copy(update={"poisson_ratio": LARGEST_RATIO})
