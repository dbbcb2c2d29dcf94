"""Every violation by files and manifest is named, alone: each test damages a dataset once.

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
from shared_schema.manifest import read_manifest
from tests.shared_schema.damage import SHARD, assert_only_problem, edit_manifest, update_checksums

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
        pytest.param(lambda m: m.update(colour="red"), ("unknown key 'colour'",), id="unknown-key"),
        pytest.param(
            lambda m: m["shards"][0].update(colour="red"), ("shards.0.colour",), id="unknown-inside"
        ),
        pytest.param(lambda m: m.pop("seed"), ("'seed' is missing",), id="missing-key"),
        pytest.param(lambda m: m.update(schema_version=2), ("schema_version", "2"), id="version"),
        pytest.param(lambda m: m.update(kind="modal"), ("kind", "modal"), id="kind"),
        pytest.param(lambda m: m.update(dimension=4), ("dimension", "4"), id="dimension"),
        pytest.param(lambda m: m.update(samples=4), ("samples", "4", "3"), id="samples"),
        pytest.param(lambda m: m.update(failed=0), ("failed", "0", "1"), id="failed"),
        pytest.param(
            lambda m: m["shards"][0].update(file="../shard-00000.h5"), ("file",), id="outside-file"
        ),
        pytest.param(
            lambda m: m.update(case={"name": "other"}), ("case_digest",), id="case-digest"
        ),
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
        pytest.param(
            lambda m: m["structured"].update(train=3), ("train 3", "test 1", "3"), id="train+test"
        ),
        pytest.param(
            lambda m: m["structured"].update(train=1, test=2), ("test", "2", "1"), id="split-counts"
        ),
        pytest.param(lambda m: m.update(structured=None), ("'structured'",), id="no-grid"),
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
    folder: Path = request.getfixturevalue(kind)
    path = folder / SHARD
    intact = path.read_bytes()
    for position in np.random.default_rng(3).choice(8 * len(intact), 250, replace=False).tolist():
        damaged = bytearray(intact)
        damaged[position // 8] ^= 1 << position % 8
        path.write_bytes(damaged)
        assert check_dataset(folder), f"bit {position}"
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


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["nodal", "structured"])
def test_a_flipped_bit_is_refused_in_reading(kind: Any, request: pytest.FixtureRequest) -> None:
    """A damaged shard raises InputError, never what h5py makes of it."""
    folder: Path = request.getfixturevalue(kind)
    manifest = read_manifest(folder)
    path = folder / SHARD
    intact = path.read_bytes()
    for position in np.random.default_rng(4).choice(8 * len(intact), 250, replace=False).tolist():
        damaged = bytearray(intact)
        damaged[position // 8] ^= 1 << position % 8
        path.write_bytes(damaged)
        with pytest.raises(InputError):
            require_intact(folder, manifest)


def test_require_intact_names_a_missing_shard(nodal: Path) -> None:
    manifest = read_manifest(nodal)
    require_intact(nodal, manifest)
    (nodal / "shard-00001.h5").unlink()
    with pytest.raises(InputError, match=r"shard-00001\.h5: no such file"):
        require_intact(nodal, manifest)
