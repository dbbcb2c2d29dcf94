"""Every violation is named, alone: each test damages an intact dataset once.

Where the violation is not a checksum itself, checksums and digest are brought up to date, so that
nothing else is wrong.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from shared_schema.checker import check_dataset, require_intact
from shared_schema.common.errors import InputError
from shared_schema.layout import SHARD_ATTRIBUTES
from shared_schema.manifest import read_manifest
from shared_schema.shard import read_shard
from tests.shared_schema.damage import (
    SHARD,
    assert_only_problem,
    damage,
    edit_manifest,
    update_checksums,
)

pytestmark = pytest.mark.faults


def test_intact_datasets_have_no_problems(nodal: Path, structured: Path) -> None:
    assert check_dataset(nodal) == []
    assert check_dataset(structured) == []


def test_missing_shard(nodal: Path) -> None:
    (nodal / "shard-00001.h5").unlink()
    assert_only_problem(nodal, "shard-00001.h5", "missing")


def test_unlisted_shard(nodal: Path) -> None:
    (nodal / "shard-00007.h5").write_bytes((nodal / SHARD).read_bytes())
    assert_only_problem(nodal, "shard-00007.h5", "not in the manifest")


@pytest.mark.parametrize("kept", [0, 100, 5000])
def test_truncated_shard(nodal: Path, kept: int) -> None:
    path = nodal / SHARD
    path.write_bytes(path.read_bytes()[:kept])
    update_checksums(nodal)
    assert_only_problem(nodal, SHARD, "HDF5", "empty" if kept == 0 else "")


def test_what_is_no_dataset_is_refused(nodal: Path) -> None:
    """As by all that reads datasets; what a dataset has wrong is listed."""
    with pytest.raises(InputError, match="nowhere: no such dataset"):
        check_dataset(nodal / "nowhere")
    (nodal / "manifest.json").unlink()
    with pytest.raises(InputError, match=r"no manifest\.json in it"):
        check_dataset(nodal)


@pytest.mark.parametrize("text", ["", "{", "[1, 2", '{"kind": nodal}', "é"])
def test_manifest_of_invalid_json(nodal: Path, text: str) -> None:
    (nodal / "manifest.json").write_text(text, encoding="utf-8")
    assert_only_problem(nodal, "manifest.json", "JSON")


@pytest.mark.parametrize("text", ["[]", "3", "null", "{}"])
def test_manifest_that_is_none(nodal: Path, text: str) -> None:
    (nodal / "manifest.json").write_text(text)
    assert_only_problem(nodal, "manifest.json")


EDITS: dict[str, Any] = {
    "name": "other",
    "case": {"name": "other"},
    "case_digest": "f" * 64,
    "seed": 6,
    "units": {"length": "mm"},
    "software": {},
    "dimension": 3,
    "samples": 4,
    "failed": 2,
    "shards": [],
    "digest": "0" * 64,
}


@pytest.mark.parametrize("key", EDITS)
def test_edited_manifest_value(nodal: Path, key: str) -> None:
    edit_manifest(nodal, lambda content: content.update({key: EDITS[key]}), seal=False)
    assert_only_problem(nodal, "manifest.json", "digest")


def test_manifest_in_another_spelling(nodal: Path) -> None:
    path = nodal / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text())))
    assert_only_problem(nodal, "manifest.json", "damaged")


@pytest.mark.parametrize(
    ("edit", "parts"),
    [
        (lambda m: m.update(colour="red"), ("unknown key 'colour'",)),
        (lambda m: m["shards"][0].update(colour="red"), ("shards.0.colour",)),
        (lambda m: m.pop("seed"), ("'seed' is missing",)),
        (lambda m: m.update(schema_version=2), ("schema_version", "2")),
        (lambda m: m.update(kind="modal"), ("kind", "modal")),
        (lambda m: m.update(dimension=4), ("dimension", "4")),
        (lambda m: m.update(samples=4), ("samples", "4", "3")),
        (lambda m: m.update(failed=0), ("failed", "0", "1")),
        (lambda m: m["shards"][0].update(file="../shard-00000.h5"), ("file",)),
        (lambda m: m.update(case={"name": "other"}), ("case_digest",)),
    ],
)
def test_resealed_manifest(
    nodal: Path, edit: Callable[[dict[str, Any]], None], parts: tuple[str, ...]
) -> None:
    edit_manifest(nodal, edit)
    assert_only_problem(nodal, *parts)


@pytest.mark.parametrize(
    ("edit", "parts"),
    [
        (lambda m: m["structured"].update(train=3), ("train 3", "test 1", "3")),
        (lambda m: m["structured"].update(train=1, test=2), ("test", "2", "1")),
        (lambda m: m.update(structured=None), ("'structured'",)),
    ],
)
def test_resealed_structured_manifest(
    structured: Path, edit: Callable[[dict[str, Any]], None], parts: tuple[str, ...]
) -> None:
    edit_manifest(structured, edit)
    assert_only_problem(structured, *parts)


def test_grid_shape_of_the_manifest(structured: Path) -> None:
    edit_manifest(structured, lambda m: m["structured"].update(grid_shape=[3, 4]))
    problems = check_dataset(structured)  # one for each shard
    assert len(problems) == 2
    assert all("(3, 4)" in problem and "grid/node_at" in problem for problem in problems)


@pytest.mark.parametrize("key", ["samples", "failed"])
def test_count_of_one_shard(nodal: Path, key: str) -> None:
    """One more in the first shard's entry and in the total: the shard's arrays are shorter."""

    def edit(content: dict[str, Any]) -> None:
        content[key] += 1
        content["shards"][0][key] += 1

    edit_manifest(nodal, edit)
    problems = check_dataset(nodal)
    axis = {"samples": "axis 'sample'", "failed": "axis 'failed'"}[key]
    assert problems
    assert all(SHARD in problem and axis in problem for problem in problems)


def test_hdf5_never_sees_a_shard_of_wrong_checksum(
    nodal: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """HDF5 can crash or hang on a damaged file, so the checksum comes first."""
    manifest = read_manifest(nodal)
    path = nodal / SHARD
    with path.open("ab") as file:
        file.write(b"!")
    opened: list[str] = []
    h5py_file = h5py.File

    def record(name: Any, *args: Any) -> Any:
        opened.append(Path(name).name)
        return h5py_file(name, *args)

    monkeypatch.setattr(h5py, "File", record)
    assert_only_problem(nodal, SHARD, "checksum")
    with pytest.raises(InputError, match=f"{SHARD}: damaged, its checksum"):
        require_intact(nodal, manifest)
    assert SHARD not in opened


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["nodal", "structured"])
def test_a_flipped_bit_of_a_shard_is_found(kind: str, request: pytest.FixtureRequest) -> None:
    """It is named, and refused in reading as InputError, never as what h5py makes of it."""
    folder: Path = request.getfixturevalue(kind)
    path, manifest = folder / SHARD, read_manifest(folder)
    intact = path.read_bytes()
    for position in np.random.default_rng(3).choice(8 * len(intact), 250, replace=False).tolist():
        damaged = bytearray(intact)
        damaged[position // 8] ^= 1 << position % 8
        path.write_bytes(damaged)
        assert check_dataset(folder), f"bit {position}"
        with pytest.raises(InputError):
            require_intact(folder, manifest)
    path.write_bytes(intact)
    assert check_dataset(folder) == []


@pytest.mark.slow
def test_every_flipped_bit_of_the_manifest_is_found(structured: Path) -> None:
    path = structured / "manifest.json"
    intact = path.read_bytes()
    with path.open("r+b", buffering=0) as file:
        for position, byte in enumerate(intact):
            for bit in range(8):
                file.seek(position)
                file.write(bytes([byte ^ 1 << bit]))
                assert check_dataset(structured), f"byte {position}, bit {bit}"
            file.seek(position)
            file.write(bytes([byte]))
    assert check_dataset(structured) == []


def test_require_intact_names_a_missing_shard(nodal: Path) -> None:
    manifest = read_manifest(nodal)
    require_intact(nodal, manifest)
    (nodal / "shard-00001.h5").unlink()
    with pytest.raises(InputError, match=r"shard-00001\.h5: no such file"):
        require_intact(nodal, manifest)


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
    (reshape("samples/wall_time", (2, 1)), ("samples/wall_time", "(2, 1)")),
    (reshape("mesh/clamped", (7,)), ("mesh/clamped", "node")),
    (reshape("failed/force", (1, 3, 2)), ("failed/force", "load")),
    (retype("samples/number", "int32"), ("samples/number", "int32")),
    (retype("samples/displacement", "float32"), ("samples/displacement", "float32", "float64")),
    (retype("mesh/clamped", "uint8"), ("mesh/clamped", "bool")),
    (lambda file: replace(file, "failed/reason", np.array([1.0])), ("failed/reason", "str")),
    (remove("mesh/loadable"), ("mesh/loadable", "missing")),
    (remove_attribute("mesh/cells", "units"), ("mesh/cells", "units", "missing")),
    (remove_attribute("mesh/cells", "description"), ("mesh/cells", "description", "missing")),
    *((remove_attribute("/", name), (name, "missing")) for name in SHARD_ATTRIBUTES),
    (set_attribute("samples/force", "units", "kN"), ("samples/force", "'kN'", "'N'")),
    (set_attribute("/", "schema_version", 2), ("schema_version", "2", "1")),
    (set_attribute("/", "kind", "structured"), ("kind", "'structured'", "'nodal'")),
    (set_attribute("/", "cell_type", "cube"), ("cell_type", "cube")),
    (set_attribute("/", "case_digest", "f" * 64), ("another case",)),
    (put("samples/displacement", (1, 5, 0), np.nan), ("samples/displacement", "NaN")),
    (put("samples/residual_norm", 0, -np.inf), ("samples/residual_norm", "infinity")),
    (link_externally, ("samples/wall_time", "link")),
    (link_softly, ("samples/wall_time", "link")),
    (store_externally, ("samples/wall_time", "outside the file")),
    (make_virtual, ("samples/wall_time", "outside the file")),
    (put("mesh/cells", (0, 0), 8), ("mesh/cells", "0 … 7")),
    (put("mesh/cells", (0, 0), -1), ("mesh/cells", "0 … 7")),
    (put("mesh/cells", 1, [0, 3, 4, 1]), ("mesh/cells", "cells 0, 1: the same")),
    (put("samples/loaded_nodes", (1, 0), 8), ("samples/loaded_nodes",)),
    (put("samples/loaded_nodes", (1, 0), -2), ("samples/loaded_nodes",)),
    (put("failed/loaded_nodes", (0, 1), 8), ("failed/loaded_nodes",)),
    (pad_first, ("samples/loaded_nodes", "padding before a loaded node")),
    (put("samples/force", (0, 1, 0), 1e-30), ("samples/force", "padding")),
    (put("samples/loaded_nodes", (1, 0), 2), ("samples/loaded_nodes", "clamped")),
    (put("failed/loaded_nodes", (0, 0), 0), ("failed/loaded_nodes", "clamped")),
    (put("failed/loaded_nodes", (0, 1), 7), ("failed/loaded_nodes", "twice")),
    (put("samples/number", 1, 3), ("more than once",)),
    (put("failed/number", 0, 0), ("more than once",)),
    (put("samples/number", 1, -1), ("sample number -1",)),
    (put("failed/number", 0, 4), ("number 4, expected 0 to 3",)),
    (put("samples/converged_reason", 1, -3), ("converged_reason", "-3", "2 to 7")),
    (put("samples/converged_reason", 1, 99), ("converged_reason", "99")),
    (put("samples/load_steps", 0, 0), ("load_steps", "at least 1")),
    (put("samples/cutbacks", 0, -1), ("cutbacks", "at least 0")),
    (put("samples/wall_time", 0, -0.1), ("wall_time", "-0.1")),
    (put("failed/load_factor", 0, 1.5), ("load_factor", "0 to 1")),
    (put("failed/reason", 0, ""), ("failed/reason", "empty")),
    (put("samples/displacement", (1, 2, 0), 1e-9), ("moves a clamped node",)),
    (put("samples/loaded_nodes", (0, 0), 4), ("a node that is not loadable",)),
]


@pytest.mark.parametrize(("change", "parts"), NODAL_DAMAGE)
def test_damaged_nodal_shard(
    nodal: Path, change: Callable[[h5py.File], None], parts: tuple[str, ...]
) -> None:
    damage(nodal, change)
    assert_only_problem(nodal, *parts)


STRUCTURED_DAMAGE: list[Any] = [
    (put("grid/node_at", (0, 0), 1), ("grid/node_at", "exactly once")),
    (put("grid/mask", (0, 0), False), ("grid/mask",)),
    (put("grid/mask", (2, 2), True), ("grid/mask",)),
    (put("samples/force", (0, 1, 2, 2), 1e-30), ("samples/force", "zero")),
    (put("samples/displacement", (1, 0, 2, 2), 1.0), ("samples/displacement", "zero")),
    (put("samples/displacement", (0, 0, 0, 0), np.inf), ("samples/displacement", "infinity")),
    (retype("samples/force", "float64"), ("samples/force", "float64", "float32")),
    (reshape("grid/mask", (3, 4)), ("grid/mask", "grid")),
    (put("samples/number", 1, 3), ("more than once",)),
    (put("samples/number", 1, -7), ("sample number -7",)),
    (put("samples/displacement", (0, 1, 0, 2), 1e-9), ("moves a clamped node",)),
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
