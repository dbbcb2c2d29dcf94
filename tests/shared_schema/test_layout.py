from __future__ import annotations

import numpy as np
import pytest

from shared_schema.layout import LAYOUTS, ArrayLayout, FileKind, shape_problem

KINDS: list[FileKind] = ["nodal", "structured", "stiffness", "loads"]


@pytest.mark.parametrize("kind", KINDS)
def test_paths_are_unique(kind: FileKind) -> None:
    paths = [layout.path for layout in LAYOUTS[kind]]
    assert len(set(paths)) == len(paths)


@pytest.mark.parametrize("kind", KINDS)
def test_types_units_and_descriptions(kind: FileKind) -> None:
    for layout in LAYOUTS[kind]:
        assert layout.dtype == "str" or np.dtype(layout.dtype).name == layout.dtype
        assert layout.units in ("1", "m", "m/s", "N", "N/m", "Pa", "s")
        assert layout.description
        assert layout.axes


@pytest.mark.parametrize(
    ("axes", "shape", "is_right"),
    [
        (("sample", "dim"), (5, 2), True),
        (("sample", "dim"), (5,), False),
        (("sample", "dim"), (5, 3), False),  # dim is known to be 2
        (("sample", "dim", "*grid"), (5, 2, 8, 4), True),
        (("sample", "dim", "*grid"), (5, 2, 8, 4, 3), True),
        (("sample", "dim", "*grid"), (5, 2, 8), False),
        (("sample", "dim", "*grid"), (5, 2, 8, 4, 3, 2), False),
    ],
)
def test_shape_problem(axes: tuple[str, ...], shape: tuple[int, ...], is_right: bool) -> None:
    layout = ArrayLayout("a", "float64", axes, "1", "")
    problem = shape_problem(layout, shape, {"dim": (2,)})
    assert (problem is None) == is_right


def test_axes_seen_before_bind_later_arrays() -> None:
    lengths: dict[str, tuple[int, ...]] = {}
    mask = ArrayLayout("mask", "bool", ("*grid",), "1", "")
    field = ArrayLayout("field", "float32", ("sample", "*grid"), "1", "")
    assert shape_problem(mask, (8, 4), lengths) is None
    assert lengths == {"*grid": (8, 4)}
    assert shape_problem(field, (7, 8, 4), lengths) is None
    problem = shape_problem(field, (7, 8, 5), lengths)
    assert problem is not None
    assert "(8, 5), expected (8, 4)" in problem
