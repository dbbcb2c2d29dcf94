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
from shared_schema.material import NeoHookean

LARGEST_RATIO = 0.4  # of Poisson, for linear elements that stand for others


def element_of(case: Mapping[str, Any]) -> str:
    """Element that a case configuration names."""
    return str(case.get("element", "linear"))


def require_linear_elements(case: Mapping[str, Any]) -> None:
    """Raise InputError unless a case has linear elements, whose equilibria the learner computes."""
    element = element_of(case)
    if element != "linear":
        raise InputError(
            f"key 'element' of the run's case = '{element}': certificates, corrections and "
            "bounds are for linear elements only; `datagen solve --start` corrects with others"
        )


def material_of_response(material: NeoHookean, case: Mapping[str, Any]) -> NeoHookean:
    """Material of the linear elements whose response stands for that of the case's elements."""
    if element_of(case) == "linear" or material.poisson_ratio <= LARGEST_RATIO:
        return material
    return material.model_copy(update={"poisson_ratio": LARGEST_RATIO})
