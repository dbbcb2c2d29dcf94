"""The learner computes equilibria of linear elements only, and refuses others."""

from __future__ import annotations

import pytest

from shared_schema.common.errors import InputError
from shared_schema.material import NeoHookean, Yeoh, ratio_at_rest
from surrogate.data.elements_of_case import material_of_response, require_linear_elements

SILICONE = NeoHookean(young_modulus=5e5, poisson_ratio=0.49)


@pytest.mark.parametrize("element", ["quadratic", "incompressible", "of a later version"])
def test_other_elements_are_refused(element: str) -> None:
    with pytest.raises(InputError, match=f"'element' of the run's case = '{element}'"):
        require_linear_elements({"element": element})


def test_linear_elements_are_known() -> None:
    """A case without the key has them."""
    require_linear_elements({})
    require_linear_elements({"element": "linear"})


def test_response_of_other_elements_does_not_lock() -> None:
    """ν = 0.4 at most, and the same E; that of linear elements is their own."""
    assert material_of_response(SILICONE, {}) == SILICONE
    softer = material_of_response(SILICONE, {"element": "incompressible"})
    assert isinstance(softer, NeoHookean)
    assert (softer.young_modulus, softer.poisson_ratio) == (5e5, 0.4)
    rubber = SILICONE.model_copy(update={"poisson_ratio": 0.3})
    assert material_of_response(rubber, {"element": "quadratic"}) == rubber


def test_response_of_rubber_and_of_several_materials_does_not_lock() -> None:
    """K/μ = 50 is ν = 0.49; the shear modulus stays."""
    rubber = Yeoh(model="yeoh", c10=1e5, bulk_modulus=1e7)
    found = material_of_response((SILICONE, rubber), {"element": "incompressible"})
    assert isinstance(found, tuple)
    assert [ratio_at_rest(each) for each in found] == pytest.approx([0.4, 0.4])
    assert found[1].lame_mu == rubber.lame_mu
