"""Write one shard: an HDF5 file that holds some samples and the mesh they live on.

The file appears under its name complete, or not at all. HDF5 builds it in memory and never sees the
disk, so that a full disk raises a plain OSError.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from shared_schema.common.atomic_file import complete_or_absent
from shared_schema.layout import SCHEMA_VERSION, ArrayLayout, FileKind, layout_for
from shared_schema.shard_problems import array_problems


def write_shard(
    path: Path, kind: FileKind, arrays: Mapping[str, Any], case_digest: str, cell_type: str
) -> str:
    """Write a shard atomically.

    Parameters
    ----------
    path : Path
        Path of the shard.
    kind : {"nodal", "structured", "stiffness", "loads"}
    arrays : mapping of str to array
        Every dataset of the kind's layout, by path, of the layout's shape and type.
    case_digest : str
        SHA-256 of the case configuration.
    cell_type : str
        meshio's name of the cells.

    Returns
    -------
    str
        SHA-256 of the file.

    Raises
    ------
    ValueError
        If the arrays are not those of the layout, or one holds a NaN or an infinity.
    OSError
        If the file cannot be written.
    """
    content = shard_content(path.name, kind, arrays, case_digest, cell_type)
    with complete_or_absent(path) as partial:
        partial.write_bytes(content)
    return hashlib.sha256(content).hexdigest()


def shard_content(
    name: str, kind: FileKind, arrays: Mapping[str, Any], case_digest: str, cell_type: str
) -> bytes:
    """Return the bytes of a shard, whose arguments are those of `write_shard`."""
    problems = array_problems(kind, {path: np.asarray(a) for path, a in arrays.items()}, {})
    if problems:
        raise ValueError(f"{name}: {problems[0]}")
    attributes: dict[str, int | str] = {
        "schema_version": SCHEMA_VERSION,
        "kind": kind,
        "case_digest": case_digest,
        "cell_type": cell_type,
    }
    with h5py.File(name, "w", driver="core", backing_store=False) as file:
        file.attrs.update(attributes)
        for layout in layout_for(kind, arrays):
            if layout.path in arrays:
                _create(file, layout, arrays[layout.path])
        file.flush()
        content: bytes = file.id.get_file_image()
    return content


def _create(file: h5py.File, layout: ArrayLayout, values: Any) -> None:
    if layout.dtype == "str":
        data, dtype = np.asarray(values, dtype=object), h5py.string_dtype()
    else:
        data, dtype = np.asarray(values), np.dtype(layout.dtype)
    compressed = layout.sparse and data.size > 0
    options: dict[str, Any] = {"compression": "gzip", "compression_opts": 1} if compressed else {}
    dataset = file.create_dataset(layout.path, data=data, dtype=dtype, **options)
    dataset.attrs["units"] = layout.units
    dataset.attrs["description"] = layout.description
