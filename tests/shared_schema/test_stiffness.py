"""A made-up stiffness beside the tiny dataset of 8 nodes in the plane, 16 degrees of freedom."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shared_schema.checker import check_dataset, require_intact
from shared_schema.common.checksum import sha256
from shared_schema.common.errors import InputError
from shared_schema.manifest import read_manifest
from shared_schema.stiffness import (
    STIFFNESS_FILE,
    Stiffness,
    read_stiffness,
    stiffness_problems,
    write_stiffness,
)
from tests.shared_schema.damage import assert_only_problem, edit_manifest

DOFS = 16


def chain() -> Stiffness:
    """2 on the diagonal, −1 beside it."""
    row, column = np.nonzero(abs(np.subtract.outer(np.arange(DOFS), np.arange(DOFS))) <= 1)
    starts = np.searchsorted(row, np.arange(DOFS + 1))
    return Stiffness(np.where(row == column, 2.0, -1.0), column, starts)


def give(folder: Path, stiffness: Stiffness) -> None:
    """Put a stiffness into a structured dataset."""
    digest = write_stiffness(folder, stiffness, read_manifest(folder).case_digest, "quad")

    def edit(content: dict[str, Any]) -> None:
        content["structured"]["stiffness"] = digest

    edit_manifest(folder, edit)


def test_round_trip(structured: Path) -> None:
    give(structured, chain())
    assert check_dataset(structured) == []
    found = read_stiffness(structured)
    for name in ("data", "indices", "indptr"):
        assert np.array_equal(getattr(found, name), getattr(chain(), name))


def test_dataset_without_one_says_nothing_of_it(structured: Path) -> None:
    assert "stiffness" not in (structured / "manifest.json").read_text()
    info = read_manifest(structured).structured
    assert info is not None
    assert info.stiffness is None


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
    structured: Path, change: Callable[[Stiffness], Stiffness], part: str
) -> None:
    assert stiffness_problems(chain(), DOFS) == []
    give(structured, change(chain()))
    assert_only_problem(structured, "stiffness.h5: dataset ", part)


def test_missing_unlisted_and_damaged_files_are_named(structured: Path) -> None:
    give(structured, chain())
    manifest = read_manifest(structured)
    require_intact(structured, manifest)
    path = structured / STIFFNESS_FILE
    content = path.read_bytes()
    path.write_bytes(content[:-1])
    assert_only_problem(structured, "stiffness.h5: damaged")
    with pytest.raises(InputError, match=r"stiffness\.h5: damaged"):
        require_intact(structured, manifest)
    path.unlink()
    assert_only_problem(structured, "stiffness.h5: missing")
    with pytest.raises(InputError, match=r"stiffness\.h5: no such file"):
        require_intact(structured, manifest)
    path.write_bytes(content)

    def forget(content: dict[str, Any]) -> None:
        del content["structured"]["stiffness"]

    edit_manifest(structured, forget)
    assert_only_problem(structured, "stiffness.h5: not in the manifest")


def test_every_flipped_byte_is_found(structured: Path) -> None:
    give(structured, chain())
    path = structured / STIFFNESS_FILE
    content, digest = path.read_bytes(), sha256(path)
    for position in range(0, len(content), 97):
        path.write_bytes(
            content[:position] + bytes([content[position] ^ 1]) + content[position + 1 :]
        )
        assert sha256(path) != digest
        assert len(check_dataset(structured)) == 1


def test_a_file_of_another_kind_is_refused(structured: Path) -> None:
    shard = structured / "shard-00000.h5"
    (structured / STIFFNESS_FILE).write_bytes(shard.read_bytes())
    with pytest.raises(InputError, match="attribute 'kind' is 'structured', expected 'stiffness'"):
        read_stiffness(structured)
