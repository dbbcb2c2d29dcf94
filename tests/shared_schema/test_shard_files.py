from __future__ import annotations

import errno
import hashlib
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from shared_schema.common.errors import InputError
from shared_schema.common.files import sha256
from shared_schema.layout import LAYOUTS, SCHEMA_VERSION, Arrays, Kind
from shared_schema.shard import read_attributes, read_shard, write_shard

CASE_DIGEST = "ab" * 32


def written(path: Path, kind: Kind, arrays: Arrays) -> Path:
    write_shard(path, kind, arrays, CASE_DIGEST, "quad")
    return path


@pytest.mark.parametrize(
    ("kind", "fixture"),
    [
        ("nodal", "nodal_arrays"),
        ("nodal", "empty_nodal_arrays"),
        ("structured", "structured_arrays"),
        ("structured", "empty_structured_arrays"),
    ],
)
def test_round_trip(
    tmp_path: Path, kind: Kind, fixture: str, request: pytest.FixtureRequest
) -> None:
    arrays: Arrays = request.getfixturevalue(fixture)
    found = read_shard(written(tmp_path / "shard-00000.h5", kind, arrays), kind)
    assert list(found) == [each.path for each in LAYOUTS[kind] if not each.optional]
    for name, values in arrays.items():
        assert found[name].dtype == values.dtype, name
        np.testing.assert_array_equal(found[name], values, err_msg=name)


def test_digest_and_attributes(tmp_path: Path, nodal_arrays: Arrays) -> None:
    path = tmp_path / "shard-00000.h5"
    digest = write_shard(path, "nodal", nodal_arrays, CASE_DIGEST, "quad")
    assert digest == sha256(path) == hashlib.sha256(path.read_bytes()).hexdigest()
    assert read_attributes(path, "nodal") == {
        "schema_version": SCHEMA_VERSION,
        "kind": "nodal",
        "case_digest": CASE_DIGEST,
        "cell_type": "quad",
    }
    with h5py.File(path) as file:
        assert file["samples/force"].attrs["units"] == "N"
        assert file["samples/force"].attrs["description"]


def test_same_content_gives_same_file(tmp_path: Path, nodal_arrays: Arrays) -> None:
    first = written(tmp_path / "a.h5", "nodal", nodal_arrays)
    second = written(tmp_path / "b.h5", "nodal", nodal_arrays)
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize(
    ("name", "value", "part"),
    [
        ("samples/displacement", np.full((2, 8, 2), np.nan), "NaN"),
        ("samples/wall_time", np.array([np.inf, 0.0]), "infinity"),
        ("samples/number", np.array([0, 1], dtype=np.int32), "int32"),
        ("samples/number", np.array([0, 1, 2]), "sample"),
        ("samples/colour", np.zeros(2), "unknown dataset 'samples/colour'"),
        ("failed/number", None, "failed/number' is missing"),
    ],
)
def test_wrong_arrays_are_not_written(
    tmp_path: Path, nodal_arrays: Arrays, name: str, value: Any, part: str
) -> None:
    arrays = {k: v for k, v in nodal_arrays.items() if k != name}
    if value is not None:
        arrays[name] = value
    with pytest.raises(ValueError, match=r"shard-00000\.h5") as error:
        write_shard(tmp_path / "shard-00000.h5", "nodal", arrays, CASE_DIGEST, "quad")
    assert part in str(error.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("limit", [0, 1, 1000, -1])
def test_a_file_that_does_not_fit_leaves_nothing(
    tmp_path: Path, nodal_arrays: Arrays, limit: int
) -> None:
    """Files may have so many bytes (-1: one less than the shard's): a plain OSError names it."""
    path = written(tmp_path / "shard-00000.h5", "nodal", nodal_arrays)
    before = path.read_bytes()
    with largest_file(limit % len(before)):
        for name in ("shard-00000.h5", "shard-00001.h5"):
            with pytest.raises(OSError, match=name) as error:
                written(tmp_path / name, "nodal", nodal_arrays)
            assert error.value.errno == errno.EFBIG
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == before


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """Let no file of this process grow beyond `size` bytes."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, r"shard-00000\.h5: no such shard"),
        ("", "empty"),
        ("coordinates, forces\n", "not a readable HDF5 file"),
    ],
)
def test_what_is_no_shard_is_refused(tmp_path: Path, content: str | None, said: str) -> None:
    path = tmp_path / "shard-00000.h5"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match=said):
        read_shard(path, "nodal")


def test_damaged_compressed_data_is_refused(tmp_path: Path, nodal_arrays: Arrays) -> None:
    """The forces are stored compressed; a broken stream cannot be read."""
    path = written(tmp_path / "shard-00000.h5", "nodal", nodal_arrays)
    with h5py.File(path) as file:
        chunk = file["samples/force"].id.get_chunk_info(0)
    content = bytearray(path.read_bytes())
    content[chunk.byte_offset : chunk.byte_offset + chunk.size] = bytes(chunk.size)
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"shard-00000\.h5"):
        read_shard(path, "nodal")
