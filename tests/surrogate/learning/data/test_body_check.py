from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from shared_schema.common.errors import InputError
from shared_schema.grid import Grid
from surrogate.learning.data.body_check import BodyRecord, require_same_body
from surrogate.learning.data.dataset import Dataset
from surrogate.mechanics.body.geometry import Geometry

CASE = {"mesh": "a", "supports": "b", "material": "c", "load": "d"}


@pytest.fixture
def geometry(dataset: Dataset) -> Geometry:
    """Return a full grid of 8 × 4 nodes with the column x = 0 clamped."""
    return dataset.geometry


def refusal(trained: Geometry, other: Geometry) -> str:
    with pytest.raises(InputError) as error:
        require_same_body(
            BodyRecord(CASE, trained.arrays()), BodyRecord(CASE, other.arrays()), "run"
        )
    return str(error.value)


def test_same_body_under_other_loads(geometry: Geometry) -> None:
    """A part of the arrays is sufficient: a nodal dataset has no grid."""
    other = BodyRecord({**CASE, "load": "e"}, {"coordinates": geometry.coordinates.copy()})
    require_same_body(BodyRecord(CASE, geometry.arrays()), other, "run")
    copy = replace(geometry, cells=geometry.cells.copy())
    require_same_body(BodyRecord(CASE, geometry.arrays()), BodyRecord(CASE, copy.arrays()), "run")


def test_last_digits_of_coordinates_may_differ(geometry: Geometry) -> None:
    """As those of two releases of gmsh do, by 1e-15 m."""
    other = replace(geometry, coordinates=geometry.coordinates * (1 + 1e-15))
    require_same_body(BodyRecord(CASE, geometry.arrays()), BodyRecord(CASE, other.arrays()), "run")


@pytest.mark.parametrize("key", ["mesh", "supports", "material"])
def test_other_configuration_is_named(geometry: Geometry, key: str) -> None:
    ours, theirs = BodyRecord(CASE, geometry.arrays()), BodyRecord({**CASE, key: 7}, {})
    with pytest.raises(InputError, match=f"^run: {key} = 7, expected '{CASE[key]}'$"):
        require_same_body(ours, theirs, "run")


def test_keys_are_chosen() -> None:
    ours, theirs = BodyRecord({"name": "a"}, {}), BodyRecord({"name": "b"}, {})
    require_same_body(ours, theirs, "run")
    with pytest.raises(InputError, match=r"^run: name = 'b', expected 'a'$"):
        require_same_body(ours, theirs, "run", keys=("name",))


@pytest.mark.parametrize(
    ("name", "index", "value"),
    [("coordinates", (5, 0), 1.7), ("cells", (0, 0), 7), ("clamped", 5, True)],
)
def test_other_array_is_named(geometry: Geometry, name: str, index: Any, value: Any) -> None:
    changed = getattr(geometry, name).copy()
    assert changed[index] != value
    changed[index] = value
    found = refusal(geometry, replace(geometry, **{name: changed}))
    assert found == f"run: the mesh is not that of the dataset, '{name}' differs"


def test_other_grid_is_named(geometry: Geometry) -> None:
    node_at = Grid.from_coordinates(geometry.coordinates).node_at
    for other in (node_at.T.copy(), node_at[:, ::-1].copy()):
        assert "'grid/node_at' differs" in refusal(
            geometry, replace(geometry, grid=Grid.of_nodes(other))
        )
