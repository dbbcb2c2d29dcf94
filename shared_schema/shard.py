"""One shard: an HDF5 file that holds some samples and the mesh they live on.

Written, it appears under its name complete, or not at all. HDF5 builds it in memory and never sees
the disk, so that a full disk raises a plain OSError. Reading refuses external links and anything
that is not laid out as `shared_schema.layout` says. Types and shapes are compared, and sizes held
against those of file and memory, before any array is read.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError, first_line
from shared_schema.common.files import complete_or_absent, require_plain
from shared_schema.common.machine import require_memory
from shared_schema.common.units import SI, Units
from shared_schema.layout import (
    SCHEMA_VERSION,
    SHARD_ATTRIBUTES,
    ArrayLayout,
    Arrays,
    FileKind,
    layout_for,
    shape_problem,
)

HEADROOM = 1 << 24  # bytes; more than the buffers of HDF5
EXPANSION = 1100  # of compressed data at most; zeros by gzip: 1032
Attributes = dict[str, int | str]
Lengths = dict[str, tuple[int, ...]]  # of axes


def write_shard(
    path: Path,
    kind: FileKind,
    arrays: Mapping[str, Any],
    case_digest: str,
    cell_type: str,
    units: Units = SI,
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
    units : Units
        Those of the case, for the attributes `units`.

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
    content = shard_content(path.name, kind, arrays, case_digest, cell_type, units)
    with complete_or_absent(path) as partial:
        partial.write_bytes(content)
    return hashlib.sha256(content).hexdigest()


def shard_content(
    name: str,
    kind: FileKind,
    arrays: Mapping[str, Any],
    case_digest: str,
    cell_type: str,
    units: Units = SI,
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
        if units != SI:
            file.attrs.update({"length_unit": units.length, "force_unit": units.force})
        for layout in layout_for(kind, arrays):
            if layout.path in arrays:
                _create(file, layout, arrays[layout.path], units)
        file.flush()
        content: bytes = file.id.get_file_image()
    return content


def _create(file: h5py.File, layout: ArrayLayout, values: Any, units: Units) -> None:
    if layout.dtype == "str":
        data, dtype = np.asarray(values, dtype=object), h5py.string_dtype()
    else:
        data, dtype = np.asarray(values), np.dtype(layout.dtype)
    compressed = layout.sparse and data.size > 0
    options: dict[str, Any] = {"compression": "gzip", "compression_opts": 1} if compressed else {}
    dataset = file.create_dataset(layout.path, data=data, dtype=dtype, **options)
    dataset.attrs["units"] = units.named(layout.units)
    dataset.attrs["description"] = layout.description


def read_shard(
    path: Path, kind: FileKind, lengths: Mapping[str, tuple[int, ...]] = MappingProxyType({})
) -> Arrays:
    """Read every dataset of a shard into memory.

    Parameters
    ----------
    path : Path
    kind : {"nodal", "structured", "stiffness", "loads"}
    lengths : mapping, optional
        Known lengths of axes, such as `ShardEntry.lengths`.

    Raises
    ------
    InputError
        If the file is missing, empty, truncated, of another kind or schema version, or not laid
        out as the schema says.
    """
    arrays = read_arrays(path, kind, lengths=lengths)
    problems = array_problems(kind, arrays, dict(lengths))
    if problems:
        raise InputError(f"{path}: {problems[0]}")
    return arrays


def read_arrays(
    path: Path,
    kind: FileKind,
    names: Collection[str] | None = None,
    lengths: Mapping[str, tuple[int, ...]] = MappingProxyType({}),
) -> Arrays:
    """Read a shard's datasets, which must exist inside the file; values are not checked.

    Parameters
    ----------
    path : Path
    kind : {"nodal", "structured", "stiffness", "loads"}
    names : collection of str, optional
        Paths of the datasets to read; all by default.
    lengths : mapping, optional
        Known lengths of axes.

    Raises
    ------
    InputError
        As `read_shard`, except for wrong values.
    """
    with _open(path, kind) as file, _damage_named(path):
        paths = dataset_paths(file)
        found = {
            each.path: file[each.path] for each in layout_for(kind, paths) if each.path in paths
        }
        size = path.stat().st_size
        problems = declaration_problems(kind, found, dict(lengths)) or size_problems(found, size)
        if problems:
            raise InputError(f"{path}: {'; '.join(problems)}")
        wanted = {k: dataset for k, dataset in found.items() if names is None or k in names}
        require_memory(sum(each.nbytes for each in wanted.values()), f"{path}: its arrays")
        return {name: values_of(dataset, size) for name, dataset in wanted.items()}


def read_attributes(path: Path, kind: FileKind) -> Attributes:
    """Read the attributes of the file itself: schema version, kind, case digest, cell type."""
    with _open(path, kind) as file, _damage_named(path):
        return {name: plain(file.attrs[name]) for name in SHARD_ATTRIBUTES}


def _open(path: Path, kind: FileKind) -> h5py.File:
    require_plain(path.parent, path)
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


def values_of(dataset: h5py.Dataset, size: int) -> NDArray[Any]:
    """Values of a dataset in a file of `size` bytes.

    Texts are read one by one: many may refer to one place of the file. ValueError if they are more
    than it.
    """
    if h5py.check_string_dtype(dataset.dtype) is None:
        return np.asarray(dataset[()])
    texts, total = dataset.asstr(), 0
    values = np.empty(dataset.shape, dtype=object)
    for place in np.ndindex(dataset.shape):
        values[place] = texts[place]
        total += len(values[place])
        if total > size:
            raise ValueError(f"dataset '{dataset.name[1:]}' holds more text than the file")
    return values


def array_problems(
    kind: FileKind, arrays: Mapping[str, NDArray[Any]], lengths: Lengths
) -> list[str]:
    """List what is wrong with the arrays of a shard: missing, unknown, shape, type, NaN.

    Parameters
    ----------
    kind : {"nodal", "structured", "stiffness", "loads"}
    arrays : mapping of str to array
    lengths : dict
        Known lengths of axes (see `shared_schema.layout.shape_problem`); new ones are added.
    """
    problems = declaration_problems(kind, arrays, lengths)
    wrong = {problem.partition("'")[2].partition("'")[0] for problem in problems}
    for name, array in arrays.items():
        if name not in wrong and array.dtype.kind == "f" and not np.isfinite(array).all():
            problems.append(f"dataset '{name}' holds a NaN or an infinity")
    return problems


def declaration_problems(
    kind: FileKind, arrays: Mapping[str, NDArray[Any] | h5py.Dataset], lengths: Lengths
) -> list[str]:
    """List what is wrong with names, types and shapes of arrays; values are not read."""
    layouts = layout_for(kind, arrays)
    known = {layout.path for layout in layouts}
    problems = [f"unknown dataset '{name}'" for name in sorted(set(arrays) - known)]
    for layout in layouts:
        if layout.path not in arrays:
            if not layout.optional:
                problems.append(f"dataset '{layout.path}' is missing")
            continue
        array = arrays[layout.path]
        if array.dtype != np.dtype(object if layout.dtype == "str" else layout.dtype):
            problems.append(
                f"dataset '{layout.path}' has type {array.dtype}, expected {layout.dtype}"
            )
            continue
        problem = shape_problem(layout, array.shape, lengths)
        if problem:
            problems.append(f"dataset '{layout.path}' {problem}")
    return problems


def size_problems(datasets: Mapping[str, h5py.Dataset], size: int) -> list[str]:
    """Name datasets that declare more bytes than a file of `size` bytes can hold."""
    problems = []
    for name, dataset in datasets.items():
        stored, filters = dataset.id.get_storage_size(), dataset.id.get_create_plist()
        chunk = int(np.prod(dataset.chunks or 0)) * dataset.dtype.itemsize
        declared = max(dataset.nbytes, chunk)  # HDF5 makes whole chunks
        most = min(stored, size) * (EXPANSION if filters.get_nfilters() else 1)
        if declared > most:
            problems.append(
                f"dataset '{name}' declares {declared} bytes, the file holds {stored} for it"
            )
    return problems


def structure_problems(file: h5py.File, kind: FileKind) -> list[str]:
    """List what is wrong with attributes, links and datasets of an open file; reads no data."""
    problems = []
    for name in SHARD_ATTRIBUTES:
        if name not in file.attrs:
            problems.append(f"attribute '{name}' is missing")
    if not problems:
        if plain(file.attrs["schema_version"]) != SCHEMA_VERSION:
            problems.append(
                f"attribute 'schema_version' is {file.attrs['schema_version']}, "
                f"expected {SCHEMA_VERSION}"
            )
        if plain(file.attrs["kind"]) != kind:
            problems.append(f"attribute 'kind' is {file.attrs['kind']!r}, expected '{kind}'")
    try:
        units = units_of(file)
    except ValueError:
        return [*problems, "attributes 'length_unit' and 'force_unit' are no units"]
    layouts = layout_for(kind, dataset_paths(file))
    known = {layout.path for layout in layouts}
    groups = {path.partition("/")[0] for path in known}
    problems += _link_problems(file, "", groups)
    for name in sorted(groups):
        if isinstance(file.get(name, getlink=True), h5py.HardLink):
            if not isinstance(file[name], h5py.Group):
                problems.append(f"'{name}' is no group")
            else:
                problems += _link_problems(file[name], f"{name}/", known)
    if problems:
        return problems
    for layout in layouts:
        dataset = file.get(layout.path)
        if dataset is None and layout.optional:
            continue
        if not isinstance(dataset, h5py.Dataset):
            problems.append(f"dataset '{layout.path}' is missing")
        elif dataset.external or dataset.is_virtual:
            problems.append(f"dataset '{layout.path}' is stored outside the file")
        else:
            for attribute, expected in (
                ("units", units.named(layout.units)),
                ("description", None),
            ):
                if attribute not in dataset.attrs:
                    problems.append(f"dataset '{layout.path}': attribute '{attribute}' is missing")
                elif expected is not None and dataset.attrs[attribute] != expected:
                    problems.append(
                        f"dataset '{layout.path}': attribute 'units' is "
                        f"{dataset.attrs[attribute]!r}, expected '{expected}'"
                    )
    return problems


def units_of(file: h5py.File) -> Units:
    """Units of a shard, metres and newtons unless it names others; ValueError if they are none."""
    names = {"length": "length_unit", "force": "force_unit"}
    given = {key: plain(file.attrs[name]) for key, name in names.items() if name in file.attrs}
    return Units.model_validate(given)


def dataset_paths(file: h5py.File) -> set[str]:
    """Paths of the members of a file's groups; no link to elsewhere is followed."""
    return {
        f"{name}/{member}"
        for name in file
        if isinstance(file.get(name, getlink=True), h5py.HardLink)
        and isinstance(file[name], h5py.Group)
        for member in file[name]
    }


def _link_problems(group: h5py.Group, prefix: str, known: set[str]) -> list[str]:
    """List what is wrong with the members of a group: links to elsewhere, unknown names."""
    problems = []
    for name in group:
        path = prefix + name
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            problems.append(f"'{path}' is a link to elsewhere, which is not allowed")
        elif path not in known:
            problems.append(f"'{path}' is unknown")
    return problems


def plain(value: Any) -> Any:
    """Turn a NumPy scalar into a Python one."""
    return value.item() if isinstance(value, np.generic) else value
