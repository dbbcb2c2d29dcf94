"""Rates of convergence to manufactured solutions, of all elements and materials."""

from __future__ import annotations

import pytest

from datagen.discretisation.element import ELEMENTS, Element
from tests.datagen.solver.manufactured import (
    MATERIALS,
    NEARLY_INCOMPRESSIBLE,
    expected_rates,
    measured,
)

CELLS = [(element, simplices) for element in ELEMENTS for simplices in (False, True)]

COMPRESSIBLE = [name for name in MATERIALS if name != NEARLY_INCOMPRESSIBLE]


def assert_rates(element: Element, d: int, simplices: bool, material: str, *meshes: int) -> None:
    *_, found = measured(element, d, simplices, material, meshes).rates
    expected = expected_rates(element, simplices)
    for rate, power in zip(found, expected, strict=True):
        assert power - 0.1 < rate < power + 0.2


@pytest.mark.parametrize(("element", "simplices"), CELLS)
def test_elements_in_the_plane(element: Element, simplices: bool) -> None:
    assert_rates(element, 2, simplices, "neo_hookean", 16, 32)


@pytest.mark.parametrize("simplices", [False, True])
def test_nearly_incompressible_in_the_plane(simplices: bool) -> None:
    assert_rates("incompressible", 2, simplices, NEARLY_INCOMPRESSIBLE, 8, 16)


@pytest.mark.slow
@pytest.mark.parametrize("material", COMPRESSIBLE[1:])
def test_materials_in_the_plane(material: str) -> None:
    assert_rates("linear", 2, False, material, 8, 16)


@pytest.mark.slow
@pytest.mark.parametrize(("element", "simplices"), CELLS)
def test_elements_in_space(element: Element, simplices: bool) -> None:
    meshes = {
        "linear": (7, 14) if simplices else (6, 12),
        "quadratic": (3, 7) if simplices else (3, 6),
        "incompressible": (3, 6) if simplices else (4, 8),
    }
    assert_rates(element, 3, simplices, "neo_hookean", *meshes[element])
