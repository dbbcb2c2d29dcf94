"""Read one shard into memory.

Reading refuses external links and anything that is not laid out as `shared_schema.layout` says.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError, first_line
from shared_schema.layout import SHARD_ATTRIBUTES, Arrays, FileKind, layout_for
from shared_schema.shard_problems import array_problems, dataset_paths, plain, structure_problems

HEADROOM = 1 << 24  # bytes; more than the buffers of HDF5
Attributes = dict[str, int | str]


def read_shard(path: Path, kind: FileKind) -> Arrays:
    """Read every dataset of a shard into memory.

    Raises
    ------
    InputError
        If the file is missing, empty, truncated, of another kind or schema version, or not laid
        out as the schema says.
    """
    arrays = read_arrays(path, kind)
    problems = array_problems(kind, arrays, {})
    if problems:
        raise InputError(f"{path}: {problems[0]}")
    return arrays


def read_arrays(path: Path, kind: FileKind, names: Collection[str] | None = None) -> Arrays:
    """Read a shard's datasets, which must exist inside the file; values are not checked.

    Parameters
    ----------
    path : Path
    kind : {"nodal", "structured", "stiffness", "loads"}
    names : collection of str, optional
        Paths of the datasets to read; all by default.

    Raises
    ------
    InputError
        As `read_shard`, except for wrong shapes, types and values.
    """
    with _open(path, kind) as file, _damage_named(path):
        paths = dataset_paths(file)
        return {
            layout.path: _read(file[layout.path])
            for layout in layout_for(kind, paths)
            if layout.path in paths and (names is None or layout.path in names)
        }


def read_attributes(path: Path, kind: FileKind) -> Attributes:
    """Read the attributes of the file itself: schema version, kind, case digest, cell type."""
    with _open(path, kind) as file, _damage_named(path):
        return {name: plain(file.attrs[name]) for name in SHARD_ATTRIBUTES}


def _open(path: Path, kind: FileKind) -> h5py.File:
    if not path.is_file():
        raise InputError(f"{path}: no such shard")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: not a readable HDF5 file (it is empty)")
    with _damage_named(path):
        file = h5py.File(path, "r")
    try:
        with _damage_named(path):
            problems = structure_problems(file, kind)
        if problems:
            raise InputError(f"{path}: {'; '.join(problems)}")
    except InputError:
        file.close()
        raise
    return file


@contextmanager
def _damage_named(path: Path) -> Iterator[None]:
    """Turn every exception that h5py raises on a damaged file into one InputError.

    Lack of memory is no damage: a MemoryError stays one.
    """
    try:
        yield
    except InputError:
        raise
    except (OSError, LookupError, RuntimeError, TypeError, ValueError) as error:
        np.empty(HEADROOM, dtype=np.uint8)  # HDF5 does not say that it has no memory; NumPy does
        raise InputError(f"{path}: not a readable HDF5 file ({first_line(error)})") from None


def _read(dataset: h5py.Dataset) -> NDArray[Any]:
    if h5py.check_string_dtype(dataset.dtype) is not None:
        return np.asarray(dataset.asstr()[()], dtype=object)
    return np.asarray(dataset[()])
