"""Every violation inside a shard is named, alone: each test damages an intact dataset once.

Where the violation is not a checksum itself, checksums and digest are brought up to date, so that
nothing else is wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from shared_schema.checker import check_dataset
from shared_schema.common.errors import InputError
from shared_schema.shard import read_shard
from tests.shared_schema.damage import SHARD, assert_only_problem, damage

pytestmark = pytest.mark.faults


def replace(file: h5py.File, name: str, data: Any, **options: Any) -> None:
    """Write a dataset anew with its old attributes."""
    attributes = dict(file[name].attrs)
    del file[name]
    dataset = file.create_dataset(name, data=data, **options)
    dataset.attrs.update(attributes)


def put(name: str, index: Any, value: Any) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        file[name][index] = value

    return change


def retype(name: str, dtype: str) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        replace(file, name, file[name][()].astype(dtype))

    return change


def reshape(name: str, shape: tuple[int, ...]) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        replace(file, name, np.zeros(shape, file[name].dtype))

    return change


def remove(name: str) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file[name]

    return change


def remove_attribute(name: str, attribute: str) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file[name].attrs[attribute]

    return change


def set_attribute(name: str, attribute: str, value: Any) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        file[name].attrs[attribute] = value

    return change


def store_externally(file: h5py.File) -> None:
    values = file["samples/wall_time"][()]
    raw = Path(file.filename).with_name("wall_time.raw")
    raw.write_bytes(values.tobytes())
    attributes = dict(file["samples/wall_time"].attrs)
    del file["samples/wall_time"]
    dataset = file.create_dataset(
        "samples/wall_time",
        values.shape,
        "float64",
        external=[(str(raw), 0, values.nbytes)],
    )
    dataset.attrs.update(attributes)


def make_virtual(file: h5py.File) -> None:
    values = file["samples/wall_time"][()]
    elsewhere = Path(file.filename).with_name("elsewhere.h5")
    with h5py.File(elsewhere, "w") as other:
        other["values"] = values
    layout = h5py.VirtualLayout(values.shape, "float64")
    layout[:] = h5py.VirtualSource(str(elsewhere), "values", values.shape)
    attributes = dict(file["samples/wall_time"].attrs)
    del file["samples/wall_time"]
    file.create_virtual_dataset("samples/wall_time", layout).attrs.update(attributes)


def link_externally(file: h5py.File) -> None:
    elsewhere = Path(file.filename).with_name("elsewhere.h5")
    with h5py.File(elsewhere, "w") as other:
        file.copy("samples/wall_time", other, "values")
    del file["samples/wall_time"]
    file["samples/wall_time"] = h5py.ExternalLink(str(elsewhere), "values")


def link_softly(file: h5py.File) -> None:
    file.move("samples/wall_time", "elsewhere")
    file["samples/wall_time"] = h5py.SoftLink("/elsewhere")


def pad_first(file: h5py.File) -> None:
    for name in ("samples/loaded_nodes", "samples/force"):
        file[name][1] = file[name][1][::-1].copy()


NODAL_DAMAGE: list[Any] = [
    pytest.param(reshape("samples/wall_time", (2, 1)), ("samples/wall_time", "(2, 1)"), id="rank"),
    pytest.param(reshape("mesh/clamped", (7,)), ("mesh/clamped", "node"), id="node-axis"),
    pytest.param(reshape("failed/force", (1, 3, 2)), ("failed/force", "load"), id="load-axis"),
    pytest.param(retype("samples/number", "int32"), ("samples/number", "int32"), id="int-type"),
    pytest.param(
        retype("samples/displacement", "float32"),
        ("samples/displacement", "float32", "float64"),
        id="float-type",
    ),
    pytest.param(retype("mesh/clamped", "uint8"), ("mesh/clamped", "bool"), id="bool-type"),
    pytest.param(
        lambda file: replace(file, "failed/reason", np.array([1.0])),
        ("failed/reason", "str"),
        id="text-type",
    ),
    pytest.param(remove("mesh/loadable"), ("mesh/loadable", "missing"), id="missing-dataset"),
    pytest.param(
        remove_attribute("mesh/cells", "units"),
        ("mesh/cells", "units", "missing"),
        id="missing-units",
    ),
    pytest.param(
        remove_attribute("mesh/cells", "description"),
        ("mesh/cells", "description", "missing"),
        id="missing-description",
    ),
    *(
        pytest.param(remove_attribute("/", name), (name, "missing"), id=f"missing-{name}")
        for name in ("schema_version", "kind", "case_digest", "cell_type")
    ),
    pytest.param(
        set_attribute("samples/force", "units", "kN"),
        ("samples/force", "'kN'", "'N'"),
        id="wrong-units",
    ),
    pytest.param(
        set_attribute("/", "schema_version", 2), ("schema_version", "2", "1"), id="schema-version"
    ),
    pytest.param(
        set_attribute("/", "kind", "structured"), ("kind", "'structured'", "'nodal'"), id="kind"
    ),
    pytest.param(set_attribute("/", "cell_type", "cube"), ("cell_type", "cube"), id="cell-type"),
    pytest.param(
        set_attribute("/", "case_digest", "f" * 64), ("another case",), id="other-case-digest"
    ),
    pytest.param(
        put("samples/displacement", (1, 5, 0), np.nan), ("samples/displacement", "NaN"), id="nan"
    ),
    pytest.param(
        put("samples/residual_norm", 0, -np.inf), ("samples/residual_norm", "infinity"), id="inf"
    ),
    pytest.param(link_externally, ("samples/wall_time", "link"), id="external-link"),
    pytest.param(link_softly, ("samples/wall_time", "link"), id="soft-link"),
    pytest.param(store_externally, ("samples/wall_time", "outside the file"), id="external-data"),
    pytest.param(make_virtual, ("samples/wall_time", "outside the file"), id="virtual"),
    # The mesh has 8 nodes: 0 … 7.
    pytest.param(put("mesh/cells", (0, 0), 8), ("mesh/cells", "0 … 7"), id="cell-of-node-8"),
    pytest.param(put("mesh/cells", (0, 0), -1), ("mesh/cells", "0 … 7"), id="cell-of-node-minus-1"),
    pytest.param(
        put("mesh/cells", 1, [0, 3, 4, 1]), ("mesh/cells", "cells 0, 1: the same"), id="cell-twice"
    ),
    pytest.param(
        put("samples/loaded_nodes", (1, 0), 8), ("samples/loaded_nodes",), id="load-at-node-8"
    ),
    pytest.param(
        put("samples/loaded_nodes", (1, 0), -2), ("samples/loaded_nodes",), id="load-at-minus-2"
    ),
    pytest.param(
        put("failed/loaded_nodes", (0, 1), 8), ("failed/loaded_nodes",), id="failed-at-node-8"
    ),
    # Node 6 alone is loaded in every sample, nodes 7 and 6 in the failed one; 0 to 2 are clamped.
    pytest.param(
        pad_first,
        ("samples/loaded_nodes", "padding before a loaded node"),
        id="padding-first",
    ),
    pytest.param(
        put("samples/force", (0, 1, 0), 1e-30),
        ("samples/force", "padding"),
        id="padding-with-force",
    ),
    pytest.param(
        put("samples/loaded_nodes", (1, 0), 2), ("samples/loaded_nodes", "clamped"), id="clamped"
    ),
    pytest.param(
        put("failed/loaded_nodes", (0, 0), 0),
        ("failed/loaded_nodes", "clamped"),
        id="clamped-in-a-failed-case",
    ),
    pytest.param(
        put("failed/loaded_nodes", (0, 1), 7), ("failed/loaded_nodes", "twice"), id="a-node-twice"
    ),
    pytest.param(put("samples/number", 1, 3), ("more than once",), id="sample-3-twice"),
    pytest.param(put("failed/number", 0, 0), ("more than once",), id="failed-sample-0-twice"),
    pytest.param(put("samples/number", 1, -1), ("sample number -1",), id="negative-number"),
    pytest.param(put("failed/number", 0, 4), ("number 4, expected 0 to 3",), id="number-beyond"),
    pytest.param(
        put("samples/converged_reason", 1, -3), ("converged_reason", "-3", "2 to 7"), id="reason"
    ),
    pytest.param(
        put("samples/converged_reason", 1, 99), ("converged_reason", "99"), id="reason-99"
    ),
    pytest.param(put("samples/load_steps", 0, 0), ("load_steps", "at least 1"), id="no-step"),
    pytest.param(put("samples/cutbacks", 0, -1), ("cutbacks", "at least 0"), id="cutbacks"),
    pytest.param(put("samples/wall_time", 0, -0.1), ("wall_time", "-0.1"), id="time"),
    pytest.param(put("failed/load_factor", 0, 1.5), ("load_factor", "0 to 1"), id="load-factor"),
    pytest.param(put("failed/reason", 0, ""), ("failed/reason", "empty"), id="no-reason"),
    pytest.param(
        put("samples/displacement", (1, 2, 0), 1e-9), ("moves a clamped node",), id="moved-support"
    ),
    pytest.param(
        put("samples/loaded_nodes", (0, 0), 4), ("a node that is not loadable",), id="not-loadable"
    ),
]


@pytest.mark.parametrize(("change", "parts"), NODAL_DAMAGE)
def test_damaged_nodal_shard(
    nodal: Path, change: Callable[[h5py.File], None], parts: tuple[str, ...]
) -> None:
    damage(nodal, change)
    assert_only_problem(nodal, *parts)


STRUCTURED_DAMAGE: list[Any] = [
    pytest.param(
        put("grid/node_at", (0, 0), 1), ("grid/node_at", "exactly once"), id="not-a-bijection"
    ),
    pytest.param(put("grid/mask", (0, 0), False), ("grid/mask",), id="mask-lacks-a-node"),
    pytest.param(put("grid/mask", (2, 2), True), ("grid/mask",), id="mask-has-no-node"),
    pytest.param(
        put("samples/force", (0, 1, 2, 2), 1e-30), ("samples/force", "zero"), id="force-off-mask"
    ),
    pytest.param(
        put("samples/displacement", (1, 0, 2, 2), 1.0),
        ("samples/displacement", "zero"),
        id="displacement-off-mask",
    ),
    pytest.param(
        put("samples/displacement", (0, 0, 0, 0), np.inf),
        ("samples/displacement", "infinity"),
        id="inf",
    ),
    pytest.param(
        retype("samples/force", "float64"), ("samples/force", "float64", "float32"), id="type"
    ),
    pytest.param(reshape("grid/mask", (3, 4)), ("grid/mask", "grid"), id="grid-shape"),
    pytest.param(put("samples/number", 1, 3), ("more than once",), id="sample-3-twice"),
    pytest.param(put("samples/number", 1, -7), ("sample number -7",), id="negative-number"),
    pytest.param(
        put("samples/displacement", (0, 1, 0, 2), 1e-9), ("moves a clamped node",), id="support"
    ),
]


@pytest.mark.parametrize(("change", "parts"), STRUCTURED_DAMAGE)
def test_damaged_structured_shard(
    structured: Path, change: Callable[[h5py.File], None], parts: tuple[str, ...]
) -> None:
    damage(structured, change)
    assert_only_problem(structured, *parts)


def test_checksum_mismatch(nodal: Path) -> None:
    with h5py.File(nodal / SHARD, "r+") as file:
        file["samples/wall_time"][0] = 0.125
    assert_only_problem(nodal, SHARD, "checksum")


def test_every_problem_is_listed(nodal: Path) -> None:
    damage(nodal, put("samples/displacement", (0, 0, 0), np.nan))
    (nodal / "shard-00001.h5").unlink()
    assert [problem.split(":")[0] for problem in check_dataset(nodal)] == [SHARD, "shard-00001.h5"]


def test_group_that_holds_itself_is_refused(nodal: Path) -> None:
    """A cycle of groups is not followed forever."""

    def change(file: h5py.File) -> None:
        file["mesh/loop"] = file["mesh"]

    damage(nodal, change)
    assert_only_problem(nodal, SHARD)
    with pytest.raises(InputError, match=SHARD):
        read_shard(nodal / SHARD, "nodal")
