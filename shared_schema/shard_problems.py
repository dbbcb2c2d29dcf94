"""Violations of the layout in one shard: attributes, links, datasets, shapes, types, NaN."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from shared_schema.layout import (
    SCHEMA_VERSION,
    SHARD_ATTRIBUTES,
    FileKind,
    layout_for,
    shape_problem,
)


def array_problems(
    kind: FileKind, arrays: Mapping[str, NDArray[Any]], lengths: dict[str, tuple[int, ...]]
) -> list[str]:
    """List what is wrong with the arrays of a shard: missing, unknown, shape, type, NaN.

    Parameters
    ----------
    kind : {"nodal", "structured", "stiffness", "loads"}
    arrays : mapping of str to array
    lengths : dict
        Known lengths of axes (see `shared_schema.layout.shape_problem`); new ones are added.
    """
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
        elif array.dtype.kind == "f" and not np.isfinite(array).all():
            problems.append(f"dataset '{layout.path}' holds a NaN or an infinity")
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
            for attribute, expected in (("units", layout.units), ("description", None)):
                if attribute not in dataset.attrs:
                    problems.append(f"dataset '{layout.path}': attribute '{attribute}' is missing")
                elif expected is not None and dataset.attrs[attribute] != expected:
                    problems.append(
                        f"dataset '{layout.path}': attribute 'units' is "
                        f"{dataset.attrs[attribute]!r}, expected '{expected}'"
                    )
    return problems


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
