"""Every violation of the contract is named, alone: each test damages an intact dataset once.

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
from shared_schema.errors import InputError
from shared_schema.manifest import digest_of, read_manifest
from shared_schema.shard import read_shard, sha256

SHARD = "shard-00000.h5"


def edit_manifest(folder: Path, edit: Callable[[dict[str, Any]], None], seal: bool = True) -> None:
    path = folder / "manifest.json"
    content = json.loads(path.read_text())
    edit(content)
    if seal:
        content["digest"] = digest_of({k: v for k, v in content.items() if k != "digest"})
    path.write_text(json.dumps(content, indent=1) + "\n")


def update_checksums(folder: Path) -> None:
    def edit(content: dict[str, Any]) -> None:
        for entry in content["shards"]:
            if (folder / entry["file"]).is_file():
                entry["sha256"] = sha256(folder / entry["file"])

    edit_manifest(folder, edit)


def damage(folder: Path, change: Callable[[h5py.File], None]) -> None:
    with h5py.File(folder / SHARD, "r+") as file:
        change(file)
    update_checksums(folder)


def replace(file: h5py.File, name: str, data: Any, **options: Any) -> None:
    """Write a dataset anew with its old attributes."""
    attributes = dict(file[name].attrs)
    del file[name]
    dataset = file.create_dataset(name, data=data, **options)
    dataset.attrs.update(attributes)


def assert_only_problem(folder: Path, *parts: str) -> None:
    problems = check_dataset(folder)
    assert len(problems) == 1, problems
    for part in parts:
        assert part in problems[0]
    assert "\n" not in problems[0]


def test_intact_datasets_have_no_problems(nodal: Path, structured: Path) -> None:
    assert check_dataset(nodal) == []
    assert check_dataset(structured) == []


# --- shards: structure --------------------------------------------------------------------------


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
        put("samples/loaded_nodes", (1, 0), 8), ("samples/loaded_nodes",), id="load-at-node-8"
    ),
    pytest.param(
        put("samples/loaded_nodes", (1, 0), -2), ("samples/loaded_nodes",), id="load-at-minus-2"
    ),
    pytest.param(
        put("failed/loaded_nodes", (0, 1), 8), ("failed/loaded_nodes",), id="failed-at-node-8"
    ),
    pytest.param(put("samples/number", 1, 3), ("more than once",), id="sample-3-twice"),
    pytest.param(put("failed/number", 0, 0), ("more than once",), id="failed-sample-0-twice"),
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


# --- files and manifest -------------------------------------------------------------------------


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


def test_missing_folder_and_missing_manifest(nodal: Path) -> None:
    assert_only_problem(nodal / "nowhere", "no such dataset")
    (nodal / "manifest.json").unlink()
    assert_only_problem(nodal, "manifest.json")


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


# --- flipped bits -------------------------------------------------------------------------------


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
    with pytest.raises(InputError, match=r"shard-00001\.h5: no such shard"):
        require_intact(nodal, manifest)


def test_group_that_holds_itself_is_refused(nodal: Path) -> None:
    """A cycle of groups is not followed forever."""

    def change(file: h5py.File) -> None:
        file["mesh/loop"] = file["mesh"]

    damage(nodal, change)
    assert_only_problem(nodal, SHARD)
    with pytest.raises(InputError, match=SHARD):
        read_shard(nodal / SHARD, "nodal")
