"""Files that declare more than they hold, and links: refused before an array is made of them."""

from __future__ import annotations

import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest

from shared_schema.checker import check_dataset
from shared_schema.common.errors import InputError
from shared_schema.common.solution_file import read_field
from shared_schema.dataset_reader import DatasetReader
from shared_schema.manifest import read_manifest
from shared_schema.shard import values_of
from tests.shared_schema.damage import SHARD, assert_only_problem, damage

pytestmark = pytest.mark.faults

HUGE = 2_000_000_000  # numbers: 16 GB
MOST = 200 << 20  # bytes that a refusal may take


@contextmanager
def little_memory() -> Iterator[None]:
    """Let this process take no more than `MOST` bytes of addresses."""
    limits = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MOST, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)


def declared(name: str, shape: tuple[int, ...], **options: object) -> Callable[[h5py.File], None]:
    """Put an array of that shape, with nothing written to it, in the place of another."""

    def change(file: h5py.File) -> None:
        attributes, dtype = dict(file[name].attrs), file[name].dtype
        del file[name]
        file.create_dataset(name, shape, dtype, **options).attrs.update(attributes)

    return change


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (
            declared("samples/wall_time", (HUGE,)),
            ("samples/wall_time", f"axis 'sample' is ({HUGE},), expected (2,)"),
        ),
        (
            declared("samples/wall_time", (HUGE,), chunks=(1 << 20,), compression="gzip"),
            ("samples/wall_time", "axis 'sample'"),
        ),
        (declared("mesh/cells", (HUGE // 4, 4)), ("mesh/cells", "declares 16000000000 bytes")),
        (
            declared("mesh/cells", (HUGE // 4, 4), chunks=(1 << 18, 4), compression="gzip"),
            ("mesh/cells", "declares 16000000000 bytes, the file holds 0 for it"),
        ),
        (
            declared("mesh/cells", (3, 4), maxshape=(None, 4), chunks=(1 << 26, 4)),
            ("mesh/cells", "declares 2147483648 bytes, the file holds 0 for it"),
        ),
    ],
)
def test_declared_sizes_are_compared_first(
    nodal: Path, change: Callable[[h5py.File], None], parts: tuple[str, ...]
) -> None:
    """In a process of little memory, which the 16 GB would not fit into."""
    damage(nodal, change)
    with little_memory():
        assert_only_problem(nodal, *parts)
        with pytest.raises(InputError, match=parts[0]):
            _ = DatasetReader(nodal).body
        with pytest.raises(InputError, match=parts[0]):
            DatasetReader(nodal).columns("samples/number")


def test_texts_that_refer_to_one_place(tmp_path: Path) -> None:
    """A hundred thousand references to one text of 1 MB are 100 GB of texts."""
    path, count = tmp_path / "texts.h5", 100_000
    with h5py.File(path, "w") as file:
        made = file.create_dataset("reason", (count,), h5py.string_dtype())
        made[0] = "x" * 1_000_000
        place = made.id.get_offset()
    content = path.read_bytes()
    reference = content[place : place + 16]
    path.write_bytes(content[:place] + reference * count + content[place + 16 * count :])
    with (
        h5py.File(path) as file,
        pytest.raises(ValueError, match="'reason' holds more text than the file"),
    ):
        values_of(file["reason"], path.stat().st_size)


@pytest.mark.parametrize("file", [SHARD, "manifest.json"])
def test_links_in_a_dataset_are_refused(nodal: Path, file: str) -> None:
    elsewhere = nodal.parent / "elsewhere"
    (nodal / file).rename(elsewhere)
    (nodal / file).symlink_to(elsewhere)
    found = check_dataset(nodal)
    assert any(f"{file}: a symbolic link, expected the file itself" in text for text in found)
    with pytest.raises(InputError, match=f"{file}: a symbolic link, expected the file itself"):
        DatasetReader(nodal)


def test_the_folder_of_a_dataset_may_be_a_link(nodal: Path) -> None:
    (nodal.parent / "link").symlink_to(nodal)
    assert check_dataset(nodal.parent / "link") == []


def test_a_manifest_larger_than_the_memory(nodal: Path) -> None:
    """A file of 8 TiB, none of which is on the disk."""
    with (nodal / "manifest.json").open("r+b") as file:
        try:
            file.truncate(1 << 43)
        except OSError:
            pytest.skip("the file system has no such files")
    with pytest.raises(InputError, match=r"manifest\.json: the file: needs 8.19e\+03 GiB"):
        read_manifest(nodal)


def test_a_solution_of_another_shape_is_not_read(tmp_path: Path) -> None:
    """Zeros of 256 MB that 256 kB of the file stand for."""
    x, path = np.arange(8.0).reshape(4, 2), tmp_path / "u.npz"
    np.savez(path, coordinates=x, displacement=x)
    assert np.array_equal(read_field(path, "displacement", x, "--start", 1e-4), x)
    np.savez_compressed(path, coordinates=x, displacement=np.zeros((1 << 24, 2)))
    with (
        little_memory(),
        pytest.raises(InputError, match=r"displacement of shape \(16777216, 2\) on another mesh"),
    ):
        read_field(path, "displacement", x, "--start", 1e-4)
