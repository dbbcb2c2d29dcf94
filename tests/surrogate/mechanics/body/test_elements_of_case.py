"""The learner knows what it computes equilibria of, and what stands for other elements."""

from __future__ import annotations

from dataclasses import replace

import pytest

from shared_schema.common.errors import InputError
from shared_schema.materials import NeoHookean, Yeoh, ratio_at_rest
from surrogate.mechanics.body.elements_of_case import (
    body_of_response,
    has_points_between,
    require_known_elements,
    with_elements,
)
from tests.surrogate.mechanics.bodies import box

SILICONE = NeoHookean(young_modulus=5e5, poisson_ratio=0.49)
SOFT = {"element": "incompressible"}


def test_linear_elements_are_known() -> None:
    """A case without the key has them."""
    for case in ({}, {"element": "linear"}):
        require_known_elements(case)


@pytest.mark.parametrize(
    ("cell_type", "whole"),
    [("quad", True), ("hexahedron", True), ("triangle", False), ("tetra", False)],
)
def test_incompressible_elements(cell_type: str, whole: bool) -> None:
    """F-bar is assembled at the nodes; Taylor and Hood's pair has points between them."""
    geometry = with_elements(box(cell_type), SOFT, None)
    assert geometry.mean_dilation == whole
    assert not with_elements(geometry, {}, None).mean_dilation
    require_known_elements(SOFT)
    assert has_points_between(SOFT, cell_type) == (not whole)
    if whole:
        assert body_of_response(geometry, SILICONE, SOFT, series=False) == (geometry, SILICONE)


def test_quadratic_elements_are_known() -> None:
    """Of every cell; a network's linear response stays that of linear elements."""
    case = {"element": "quadratic"}
    require_known_elements(case)
    assert has_points_between(case, "quad")
    with pytest.raises(InputError, match="'of a later version': certificates"):
        require_known_elements({"element": "of a later version"})


def test_response_of_other_elements_does_not_lock() -> None:
    """ν = 0.4 at most, and the same E; that of linear elements is their own."""
    geometry = box("tetra")
    assert body_of_response(geometry, SILICONE, {}, series=False) == (geometry, SILICONE)
    body, softer = body_of_response(
        with_elements(geometry, SOFT, None), SILICONE, SOFT, series=False
    )
    assert not body.mean_dilation
    assert isinstance(softer, NeoHookean)
    assert (softer.young_modulus, softer.poisson_ratio) == (5e5, 0.4)
    rubber = SILICONE.model_copy(update={"poisson_ratio": 0.3})
    assert body_of_response(geometry, rubber, {"element": "quadratic"}, series=False)[1] == rubber


def test_load_series_are_those_of_linear_elements() -> None:
    geometry = replace(box("hexahedron"), mean_dilation=True)
    body, softer = body_of_response(geometry, SILICONE, SOFT, series=True)
    assert not body.mean_dilation
    assert ratio_at_rest(softer) == pytest.approx(0.4)  # type: ignore[arg-type]


def test_response_of_rubber_and_of_several_materials_does_not_lock() -> None:
    """K/μ = 50 is ν = 0.49; the shear modulus stays."""
    rubber = Yeoh(model="yeoh", c10=1e5, bulk_modulus=1e7)
    _, found = body_of_response(box("tetra"), (SILICONE, rubber), SOFT, series=False)
    assert isinstance(found, tuple)
    assert [ratio_at_rest(each) for each in found] == pytest.approx([0.4, 0.4])
    assert found[1].lame_mu == rubber.lame_mu
