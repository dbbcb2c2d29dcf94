"""Files that hold one solution: ``.npz`` for programs, ``.vtu`` (and ``.xdmf``) for ParaView.

``.npz`` has ``coordinates`` (n, d), ``force`` (n, d), ``displacement`` (n, d) and any further
fields of nodes and cells under their names; and ``force_between`` (n_between, d), if the load has
forces between the nodes (`shared_schema.common.bodies.points_between`).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from zipfile import BadZipFile, ZipFile

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError
from shared_schema.common.files import complete_or_absent

BETWEEN = "force_between"
SUFFIXES = (".npz", ".vtu", ".xdmf")


def require_suffix(path: Path, allowed: tuple[str, ...] = SUFFIXES, option: str = "--out") -> None:
    """Raise InputError unless the file name ends as one of `allowed` and its folder exists."""
    if path.suffix not in allowed:
        raise InputError(f"{option} '{path}': expected a file name ending in {', '.join(allowed)}")
    if not path.parent.is_dir():
        raise InputError(f"{option} '{path}': no such folder {path.parent}")
    if path.is_dir():
        raise InputError(f"{option} '{path}': expected a file, found a folder")


def in_space(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Give vectors (n, d) three components, as ParaView wants them: (n, 3)."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def flat(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Tensors (n, 3, 3) as (n, 9), row by row, as ParaView wants them; scalars as they are."""
    return values.reshape(len(values), 9) if values.ndim == 3 else values


def write_solution(
    path: Path,
    coordinates: NDArray[np.float64],
    cells: NDArray[np.int64],
    cell_type: str,
    fields: Mapping[str, NDArray[np.float64]],
    cell_fields: Mapping[str, NDArray[np.float64]] = MappingProxyType({}),
    force_between: NDArray[np.float64] | None = None,
) -> None:
    """Write fields on the undeformed mesh; the file appears complete or not at all.

    Parameters
    ----------
    path : Path
        Ending in .npz, .vtu or .xdmf.
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
    cell_type : str
        meshio's name.
    fields : mapping of str to array (n_nodes, d)
        ``force`` in N, ``displacement`` in m, and so on.
    cell_fields : mapping of str to array (n_cells, …)
        Scalars and tensors of the cells.
    force_between : array, (n_between, d), optional
        Forces between the nodes in N, for ``.npz``; ParaView has no points for them.
    """
    require_suffix(path)
    between = {} if force_between is None else {BETWEEN: force_between}
    with complete_or_absent(path) as partial:
        if path.suffix == ".npz":
            with partial.open("wb") as file:
                arrays = {"coordinates": coordinates, **fields, **between, **cell_fields}
                np.savez(file, **arrays)  # type: ignore[arg-type]
        else:
            _write_mesh(partial, coordinates, cells, cell_type, fields, cell_fields)


def _write_mesh(
    path: Path,
    coordinates: NDArray[np.float64],
    cells: NDArray[np.int64],
    cell_type: str,
    fields: Mapping[str, NDArray[np.float64]],
    cell_fields: Mapping[str, NDArray[np.float64]],
) -> None:
    import meshio

    mesh = meshio.Mesh(
        in_space(coordinates),
        [(cell_type, cells)],
        point_data={name: in_space(values) for name, values in fields.items()},
        cell_data={name: [flat(values)] for name, values in cell_fields.items()},
    )
    if path.suffix == ".xdmf":
        meshio.write(path, mesh, file_format="xdmf", data_format="XML")
    else:
        meshio.write(path, mesh, file_format="vtu")


def read_field(
    path: Path, name: str, coordinates: NDArray[np.float64], option: str, tolerance: float
) -> NDArray[np.float64]:
    """Read a field of a solution (``.npz``) on the same mesh, (n_nodes, d).

    Parameters
    ----------
    path : Path
    name : str
        Field, such as ``displacement``.
    coordinates : array, (n_nodes, d)
        Of the mesh that the field is for, in m.
    option : str
        Option that names the file, for messages.
    tolerance : float
        Largest difference of positions, relative to the size of the mesh.

    Raises
    ------
    InputError
        If the file is no such file, or is of another mesh.
    """
    arrays = {}
    try:
        with ZipFile(path) as archive:
            shapes = {each: _declared_shape(archive, each) for each in (name, "coordinates")}
        fits = all(shape == coordinates.shape for shape in shapes.values())
        if fits:
            with np.load(path) as file:
                arrays = {each: np.asarray(file[each], dtype=np.float64) for each in shapes}
    except (OSError, ValueError, KeyError, EOFError, TypeError, BadZipFile):
        raise InputError(
            f"{option} '{path}': expected a file .npz with '{name}' and 'coordinates'"
        ) from None
    most = tolerance * np.ptp(coordinates, axis=0).max()
    if not fits or not np.abs(arrays["coordinates"] - coordinates).max() < most:
        raise InputError(
            f"{option} '{path}': {name} of shape {shapes[name]} on another mesh, "
            f"expected {coordinates.shape} at its nodes"
        )
    return arrays[name]


def read_forces_between(
    path: Path, shape: tuple[int, ...], option: str
) -> NDArray[np.float64] | None:
    """Read the forces between the nodes of a solution (``.npz``); None if it has none.

    Raises
    ------
    InputError
        If they have another shape than (n_between, d).
    """
    try:
        with ZipFile(path) as archive:
            if f"{BETWEEN}.npy" not in archive.namelist():
                return None
            found = _declared_shape(archive, BETWEEN)
        if found == shape:
            with np.load(path) as file:
                return np.asarray(file[BETWEEN], dtype=np.float64)
    except (OSError, ValueError, KeyError, EOFError, TypeError, BadZipFile):
        raise InputError(f"{option} '{path}': '{BETWEEN}' cannot be read") from None
    raise InputError(f"{option} '{path}': {BETWEEN} of shape {found}, expected {shape}")


def _declared_shape(archive: ZipFile, name: str) -> tuple[int, ...]:
    """Shape that the header of an array in an ``.npz`` file declares; no value is read."""
    with archive.open(f"{name}.npy") as file:
        major, _ = np.lib.format.read_magic(file)
        header = (
            np.lib.format.read_array_header_1_0
            if major == 1
            else (np.lib.format.read_array_header_2_0)
        )
        shape, _, dtype = header(file)
    if dtype.itemsize > 16:
        raise ValueError(f"numbers of {dtype.itemsize} bytes")
    return tuple(shape)
