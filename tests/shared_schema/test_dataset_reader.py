"""Whole datasets: the shards one at a time, and joined in the order of their sample numbers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from shared_schema.common.errors import InputError
from shared_schema.dataset_reader import DatasetReader
from shared_schema.layout import Arrays
from shared_schema.manifest import ShardEntry, read_manifest, write_manifest
from shared_schema.shard import read_shard, write_shard
from tests.shared_schema.conftest import make_nodal
from tests.shared_schema.damage import SHARD, damage


def test_shards_in_turn(nodal: Path) -> None:
    reader = DatasetReader(nodal, "nodal")
    assert reader.manifest == read_manifest(nodal)
    assert reader.cell_type == "quad"
    found = list(reader)
    assert [entry.file for entry, _ in found] == ["shard-00000.h5", "shard-00001.h5"]
    for entry, arrays in found:
        expected = read_shard(nodal / entry.file, "nodal")
        assert arrays.keys() == expected.keys()
        assert all(np.array_equal(arrays[name], expected[name]) for name in expected)
        assert np.array_equal(reader.shard(entry)["samples/force"], expected["samples/force"])


def test_one_shard_at_a_time(nodal: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []

    def counted(path: Path, *others: Any) -> Arrays:
        read.append(path.name)
        return read_shard(path, *others)

    monkeypatch.setattr("shared_schema.dataset_reader.read_shard", counted)
    reader = DatasetReader(nodal)
    assert read == []
    next(iter(reader))
    assert read == ["shard-00000.h5"]
    reader.joined(("samples/force", "samples/displacement", "failed/reason"))
    assert read[1:] == ["shard-00000.h5", "shard-00001.h5"]


def test_body(structured: Path) -> None:
    body = DatasetReader(structured).body
    shard = read_shard(structured / SHARD, "structured")
    assert sorted(body) == [
        "grid/mask",
        "grid/node_at",
        "mesh/cells",
        "mesh/clamped",
        "mesh/coordinates",
        "mesh/loadable",
    ]
    assert all(np.array_equal(body[name], shard[name]) for name in body)


@pytest.fixture
def shuffled(nodal: Path) -> Path:
    """Samples 7, 1 and failed ones 5, 2 in the first shard, 4 and 0 in the second."""
    entries = []
    manifest = read_manifest(nodal)
    for index, arrays in enumerate((make_nodal([7, 1], [5, 2]), make_nodal([4], [0]))):
        arrays["samples/wall_time"] = arrays["samples/number"] / 8
        arrays["failed/load_factor"] = arrays["failed/number"] / 8
        file = f"shard-0000{index}.h5"
        digest = write_shard(nodal / file, "nodal", arrays, manifest.case_digest, "quad")
        counts = len(arrays["samples/number"]), len(arrays["failed/number"])
        entries.append(ShardEntry(file=file, samples=counts[0], failed=counts[1], sha256=digest))
    write_manifest(nodal, manifest.model_copy(update={"shards": tuple(entries), "failed": 3}))
    return nodal


def test_joined_in_the_order_of_the_numbers(shuffled: Path) -> None:
    names = ("samples/wall_time", "samples/displacement", "failed/load_factor", "samples/number")
    arrays = DatasetReader(shuffled).joined(names)
    assert tuple(arrays) == names
    assert arrays["samples/number"].tolist() == [1, 4, 7]
    assert arrays["samples/wall_time"].tolist() == [1 / 8, 4 / 8, 7 / 8]
    assert arrays["failed/load_factor"].tolist() == [0, 2 / 8, 5 / 8]
    first, second = make_nodal([7, 1], [])["samples/displacement"], make_nodal([4], [])
    expected = [first[1], second["samples/displacement"][0], first[0]]
    assert np.array_equal(arrays["samples/displacement"], np.stack(expected))


def lose(path: Path) -> None:
    path.unlink()


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1])


@pytest.mark.parametrize("damage", [lose, cut])
def test_damage_is_refused(nodal: Path, damage: Callable[[Path], None]) -> None:
    damage(nodal / "shard-00001.h5")
    with pytest.raises(InputError, match=r"shard-00001\.h5"):
        DatasetReader(nodal, "nodal")


def test_another_kind_is_refused(nodal: Path) -> None:
    with pytest.raises(InputError, match="a nodal dataset, expected a structured one"):
        DatasetReader(nodal, "structured")


def test_a_mesh_with_a_repeated_cell_is_refused(nodal: Path) -> None:
    """Both programs take the mesh of a dataset from here, before dolfinx or PyTorch get it."""

    def repeat(file: h5py.File) -> None:
        file["mesh/cells"][1] = file["mesh/cells"][0]

    damage(nodal, repeat)
    with pytest.raises(InputError, match=r"00000\.h5: dataset 'mesh/cells': cells 0, 1: the same"):
        _ = DatasetReader(nodal).body
