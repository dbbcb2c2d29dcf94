"""Families of shapes: the polynomial, its ranges, and what tangles a mesh."""

from __future__ import annotations

import numpy as np
import pytest

from shared_schema.common.bodies.shape_family import ShapeFamily, design
from shared_schema.common.errors import InputError

SQUARE = np.array([[0.0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]])
CELLS = np.array([[0, 1, 4, 3], [1, 2, 5, 4]])
RANGES = {"width": (1.0, 3.0), "tilt": (-0.2, 0.4)}


def positions(width: float, tilt: float) -> np.ndarray:
    """A quadratic map of the parameters: the middle moves by tilt², the right side by width."""
    x = SQUARE.copy()
    x[:, 0] *= width / 2
    x[[1, 4], 0] += tilt**2
    x[3:, 0] += width * tilt
    return x


@pytest.fixture
def family() -> ShapeFamily:
    low, high = np.array(list(RANGES.values())).T
    values = (low + high + design(2) * (high - low)) / 2
    return ShapeFamily.through(RANGES, np.array([positions(*row) for row in values]))


def test_a_quadratic_map_is_exact_everywhere(family: ShapeFamily) -> None:
    for values in ((1.0, -0.2), (3.0, 0.4), (1.7, 0.3), (3.5, -0.4)):
        found = family.coordinates(np.array(values))
        assert found == pytest.approx(positions(*values), abs=1e-14)
    assert np.array_equal(family.terms[0], positions(2.0, 0.1))


def test_drawn_parameters_are_uniform_in_their_ranges(family: ShapeFamily) -> None:
    drawn = np.array([family.drawn(7, number) for number in range(2000)])
    low, high = family.ranges.T
    assert ((drawn >= low) & (drawn <= high)).all()
    shares = (drawn - low) / (high - low)
    assert shares.mean(axis=0) == pytest.approx([0.5, 0.5], abs=3 / np.sqrt(12 * 2000))
    assert shares.var(axis=0) == pytest.approx([1 / 12, 1 / 12], rel=0.1)
    assert abs(np.corrcoef(shares.T)[0, 1]) < 3 / np.sqrt(2000)
    assert np.array_equal(family.drawn(7, 5), drawn[5])


def test_shapes_keep_through_a_shard(family: ShapeFamily) -> None:
    again = ShapeFamily.of_arrays(family.arrays())
    assert again is not None
    assert again.names == ("width", "tilt")
    assert np.array_equal(again.terms, family.terms)
    assert ShapeFamily.of_arrays({}) is None


def test_tangled_shapes_are_told_with_the_parameter(family: ShapeFamily) -> None:
    assert family.tangled(CELLS, "quad") is None
    low, high = np.array([1.0, -0.2]), np.array([3.0, 1.5])  # the middle passes the right side
    values = (low + high + design(2) * (high - low)) / 2
    ranges = {"width": (1.0, 3.0), "tilt": (-0.2, 1.5)}
    wide = ShapeFamily.through(ranges, np.array([positions(*row) for row in values]))
    said = wide.tangled(CELLS, "quad")
    assert said is not None
    assert said.startswith("tilt = 1.5: cell 1 turned over")
    assert "expected narrower ranges" in said


def test_parameters_by_name(family: ShapeFamily) -> None:
    assert family.checked({"tilt": 0.0}, CELLS, "quad") == pytest.approx([2.0, 0.0])
    assert family.outside(np.array([3.5, 0.0])) == [
        "parameter width = 3.5, outside of its range, 1 to 3"
    ]
    for given, said in (
        ({"height": 1.0}, "parameter height=1.0: no such parameter, expected width, tilt"),
        ({"width": np.inf}, "parameter width=inf: expected a finite number"),
        ({"width": -1.0}, "parameter width = -1, tilt = 0.1: cells 0, 1 turned over"),
    ):
        with pytest.raises(InputError, match=said):
            family.checked(given, CELLS, "quad")
