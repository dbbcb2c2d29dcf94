"""Arrays that only some bodies have: written, read, and each violation named alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from shared_schema.common.bodies.groups import GroupParts, group_arrays, groups_of, parts_of
from shared_schema.content_problems import _actuator_problems, body_problems
from shared_schema.layout import Arrays
from shared_schema.shard import read_shard, write_shard

Change = Callable[[Arrays], None]
HELD_BETWEEN = [0, 2, 3]  # (0, 1), (0, 1, 3, 4), (0, 3), (1, 2), …: edges of nodes 0 to 3


@pytest.fixture
def body(nodal_arrays: Arrays) -> Arrays:
    """Nodes 0 to 2 are clamped; node 3 slides along y, nodes 6 and 7 are loaded and pressed."""
    arrays = nodal_arrays
    held = np.repeat(arrays["mesh/clamped"][:, None], 2, axis=1)
    held[3, 0] = True
    arrays["samples/displacement"][:, 3] = 0.0
    arrays["mesh/held"] = held
    arrays["mesh/material"] = np.array([0, 1, 0])
    arrays["mesh/fibres"] = np.array([[[0.6, 0.8]], [[0.0, 0.0]], [[-1.0, 0.0]]])
    arrays |= group_arrays(
        {"root": arrays["mesh/clamped"], "end": arrays["mesh/loadable"]},
        arrays["mesh/cells"],
        "quad",
        {"root": GroupParts(np.array([[0, 1]]), np.array([0]))},
    )
    arrays["mesh/pressed"] = np.array([[6, 7], [7, 4]])
    arrays["mesh/pressed_surface"] = np.array([0, 1])
    arrays["samples/pressure"] = np.array([[1.0, 2.0], [3.0, 4.0]])
    arrays["failed/pressure"] = np.array([[5.0, 6.0]])
    for group, count in (("samples", 2), ("failed", 1)):  # 10 edges and 3 centres
        arrays[f"{group}/force_between"] = np.ones((count, 13, 2))
        arrays[f"{group}/force_between"][:, HELD_BETWEEN] = 0.0
    return arrays


def put(name: str, index: Any, value: Any) -> Change:
    def change(arrays: Arrays) -> None:
        arrays[name][index] = value

    return change


def fewer(name: str) -> Change:
    def change(arrays: Arrays) -> None:
        arrays[name] = arrays[name][:, :-1]

    return change


def drop(name: str) -> Change:
    def change(arrays: Arrays) -> None:
        del arrays[name]

    return change


def test_written_and_read(body: Arrays, tmp_path: Path) -> None:
    assert body_problems(body) == []
    write_shard(tmp_path / "shard-00000.h5", "nodal", body, "0" * 64, "quad")
    found = read_shard(tmp_path / "shard-00000.h5", "nodal")
    assert found.keys() == body.keys()
    for name, values in body.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    groups = groups_of(found)
    assert list(groups) == ["end", "root"]
    np.testing.assert_array_equal(groups["root"], body["mesh/clamped"])
    root = parts_of(found, "quad")["root"]
    assert (root.facets.tolist(), root.cells.tolist()) == ([[0, 1]], [0])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (put("mesh/held", (3, 1), True), "'mesh/held' is not all true at the clamped nodes alone"),
        (put("mesh/held", (0, 1), False), "'mesh/held' is not all true at the clamped nodes alone"),
        (put("samples/displacement", (0, 3, 0), 1e-9), "moves a held component"),
        (put("samples/loaded_nodes", (0, 0), 3), "'samples/force' has a force on a held component"),
        (put("failed/loaded_nodes", (0, 1), 3), "'failed/force' has a force on a held component"),
        (put("mesh/group_names", 0, "root"), "'mesh/group_names' has a name twice"),
        (drop("mesh/groups"), "do not stand together"),
        (drop("mesh/group_cells"), "'mesh/group_facets' and 'mesh/group_cells' stand together"),
        (fewer("mesh/group_facets"), "'mesh/group_facets' has 7 facets, the surface 8"),
        (put("mesh/material", 1, -1), "'mesh/material' is -1, expected 0 at least"),
        (
            put("mesh/fibres", (2, 0), [0.5, 0]),
            "'mesh/fibres' has a vector of length 0.5 in",
        ),
        (put("mesh/fibres", (2, 0), [np.nan, 0]), "'mesh/fibres' has "),
        (put("mesh/pressed", (0, 1), 4), "names a facet that is not on the surface"),
        (drop("mesh/pressed"), "stand together"),
        (put("mesh/pressed_surface", 1, 0), "does not number the surfaces in turn"),
        (put("samples/force_between", (0, 3, 1), 1.0), "between' has a force on a held component"),
        (fewer("failed/force_between"), "'failed/force_between' has 12 points, expected 13"),
    ],
)
def test_violations(body: Arrays, change: Change, said: str) -> None:
    change(body)
    (problem,) = body_problems(body)
    assert said in problem


def test_values_of_actuators(body: Arrays) -> None:
    """Those of a case with two actuators stand together; lengths and volumes are positive."""
    case = SimpleNamespace(case={"actuators": {"left": {}, "top": {}}})
    samples = len(body["samples/number"])
    names = [f"samples/{name}" for name in ("actuation", "amplitude", "quantity")]
    right = body | {name: np.ones((samples, 2)) for name in names}
    assert _actuator_problems(case, right) == []  # type: ignore[arg-type]
    for change, said in (
        ({names[2]: np.zeros((samples, 2))}, "a length or volume of 0"),
        ({names[1]: np.full((samples, 2), np.nan)}, "not finite"),
        ({names[0]: np.ones((samples, 1))}, "of the 2 actuators stand together"),
    ):
        (problem,) = _actuator_problems(case, right | change)  # type: ignore[arg-type]
        assert said in problem
    (problem,) = _actuator_problems(case, body)  # type: ignore[arg-type]
    assert "stand together" in problem
