"""A made-up stiffness beside the tiny dataset of 8 nodes in the plane, 16 degrees of freedom."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from shared_schema.checker import check_dataset, require_intact
from shared_schema.common.errors import InputError
from shared_schema.common.files import sha256
from shared_schema.manifest import read_manifest, write_manifest
from shared_schema.stiffness import (
    STIFFNESS_FILE,
    Stiffness,
    read_stiffness,
    stiffness_problems,
    write_stiffness,
)
from tests.shared_schema.conftest import make_dataset
from tests.shared_schema.damage import assert_only_problem

DOFS = 16


def chain() -> Stiffness:
    """2 on the diagonal, −1 beside it."""
    row, column = np.nonzero(abs(np.subtract.outer(np.arange(DOFS), np.arange(DOFS))) <= 1)
    starts = np.searchsorted(row, np.arange(DOFS + 1))
    return Stiffness(np.where(row == column, 2.0, -1.0), column, starts)


def give(folder: Path, stiffness: Stiffness) -> None:
    """Put a stiffness into a dataset."""
    manifest = read_manifest(folder)
    digest = write_stiffness(folder, stiffness, manifest.case_digest, "quad")
    record(folder, digest)


def record(folder: Path, digest: str | None) -> None:
    """Let the manifest say that a dataset has a stiffness, or none."""
    manifest = read_manifest(folder)
    if manifest.structured is None:
        write_manifest(folder, manifest.model_copy(update={"stiffness": digest}))
    else:
        info = manifest.structured.model_copy(update={"stiffness": digest})
        write_manifest(folder, manifest.model_copy(update={"structured": info}))


@pytest.fixture(params=["nodal", "structured"])
def dataset(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return make_dataset(tmp_path / "dataset", request.param)


def test_round_trip(dataset: Path) -> None:
    give(dataset, chain())
    assert check_dataset(dataset) == []
    found = read_stiffness(dataset)
    for name in ("data", "indices", "indptr"):
        assert np.array_equal(getattr(found, name), getattr(chain(), name))


def test_where_the_manifest_says_it(nodal: Path, structured: Path) -> None:
    for folder in (nodal, structured):
        give(folder, chain())
        assert read_manifest(folder).stiffness_checksum == sha256(folder / STIFFNESS_FILE)
    assert read_manifest(nodal).stiffness == sha256(nodal / STIFFNESS_FILE)
    assert read_manifest(structured).stiffness is None
    info = read_manifest(structured).structured
    assert info is not None
    assert info.stiffness == sha256(structured / STIFFNESS_FILE)


def test_a_nodal_entry_in_a_structured_manifest_is_named(structured: Path) -> None:
    manifest = read_manifest(structured)
    write_manifest(structured, manifest.model_copy(update={"stiffness": "0" * 64}))
    assert_only_problem(structured, "'stiffness' does not fit the kind 'structured'")


def asymmetric(k: Stiffness) -> Stiffness:
    data = k.data.copy()
    data[1] *= 1 + 1e-6
    return Stiffness(data, k.indices, k.indptr)


def one_sided(k: Stiffness) -> Stiffness:
    starts = k.indptr.copy()
    starts[1:] -= 1
    return Stiffness(k.data[[0, *range(2, len(k.data))]], np.delete(k.indices, 1), starts)


def descending(k: Stiffness) -> Stiffness:
    columns = k.indices.copy()
    columns[:2] = columns[1::-1]
    return Stiffness(k.data, columns, k.indptr)


def outside(k: Stiffness) -> Stiffness:
    columns = k.indices.copy()
    columns[-1] = DOFS
    return Stiffness(k.data, columns, k.indptr)


def of_another_mesh(k: Stiffness) -> Stiffness:
    return Stiffness(k.data[:-2], k.indices[:-2], k.indptr[:-1])


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (asymmetric, "'stiffness/data' is not symmetric"),
        (one_sided, "'stiffness/data' is not symmetric"),
        (descending, "'stiffness/indices' is not ascending in every row"),
        (outside, "'stiffness/indices' names a column outside 0 … 15"),
        (of_another_mesh, "'stiffness/indptr' is not that of 16 rows and 44 entries"),
    ],
)
def test_what_is_no_stiffness_of_the_mesh_is_named(
    dataset: Path, change: Callable[[Stiffness], Stiffness], part: str
) -> None:
    assert stiffness_problems(chain(), DOFS) == []
    give(dataset, change(chain()))
    assert_only_problem(dataset, "stiffness.h5: dataset ", part)


def test_missing_unlisted_and_damaged_files_are_named(dataset: Path) -> None:
    give(dataset, chain())
    manifest = read_manifest(dataset)
    require_intact(dataset, manifest)
    path = dataset / STIFFNESS_FILE
    content = path.read_bytes()
    path.write_bytes(content[:-1])
    assert_only_problem(dataset, "stiffness.h5: damaged")
    with pytest.raises(InputError, match=r"stiffness\.h5: damaged"):
        require_intact(dataset, manifest)
    path.unlink()
    assert_only_problem(dataset, "stiffness.h5: missing")
    with pytest.raises(InputError, match=r"stiffness\.h5: no such file"):
        require_intact(dataset, manifest)
    path.write_bytes(content)
    record(dataset, None)
    assert_only_problem(dataset, "stiffness.h5: not in the manifest")


def test_a_file_of_another_kind_is_refused(dataset: Path) -> None:
    shard = dataset / "shard-00000.h5"
    (dataset / STIFFNESS_FILE).write_bytes(shard.read_bytes())
    with pytest.raises(InputError, match=r"attribute 'kind' is '\w+', expected 'stiffness'"):
        read_stiffness(dataset)
