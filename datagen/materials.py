"""Directions of fibres of every cell, from the key `fibres` of the materials of a case."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.errors import InputError
from shared_schema.materials import FibreFile, Material, WithFibres, as_tuple

Array = NDArray[np.float64]


def fibres_of_cells(
    materials: Material | Sequence[Material], parts: NDArray[np.int64] | None, mesh: RawMesh
) -> Array | None:
    """Unit vectors of the fibres in each cell; None if no material has any.

    Parameters
    ----------
    materials : Material, or sequence of some
    parts : array of int, (n_cells,), or None
        Position of each cell's material, if there are several.
    mesh : RawMesh

    Returns
    -------
    array, (n_cells, families, d), or None
        Rows of 0 where a cell's material has fewer families than another.

    Raises
    ------
    InputError
        If a vector has another number of components than the mesh, or a file of directions does not
        fit mesh or material, or has a vector without direction in a cell of the material.
    """
    several, dimension = as_tuple(materials), mesh.coordinates.shape[1]
    of_cells = np.zeros(len(mesh.cells), dtype=np.int64) if parts is None else parts
    pieces: dict[int, Array] = {}
    for number, material in enumerate(several):
        if isinstance(material, WithFibres) and material.fibres is not None:
            key = "key 'material" + (f".{number}" if parts is not None else "")
            cells = np.flatnonzero(of_cells == number)
            pieces[number] = _unit_vectors(material, key, cells, len(mesh.cells), dimension)
    if not pieces:
        return None
    families = max(vectors.shape[1] for vectors in pieces.values())
    result = np.zeros((len(mesh.cells), families, dimension))
    for number, vectors in pieces.items():
        result[of_cells == number, : vectors.shape[1]] = vectors
    return result


def _unit_vectors(
    material: WithFibres, key: str, cells: NDArray[np.int64], count: int, dimension: int
) -> Array:
    """Unit vectors of a material in its cells, (n_cells_of_it, families, d)."""
    if not isinstance(material.fibres, FibreFile):
        vectors = material.fibres or ()
        if any(len(vector) != dimension for vector in vectors):
            listed = [list(vector) for vector in vectors]
            raise InputError(f"{key}.fibres' = {listed}: expected {dimension} components each")
        given = np.broadcast_to(np.array(vectors), (len(cells), len(vectors), dimension))
    else:
        given = _of_file(material, material.fibres, key, count, dimension)[cells]
    lengths = np.linalg.norm(given, axis=2)
    fit = np.isfinite(lengths) & (lengths > 0)
    if not fit.all():
        cell, family = np.argwhere(~fit)[0]
        raise InputError(
            f"{key}.fibres.file': the vector {given[cell, family].tolist()} of cell "
            f"{cells[cell]}, family {family}, has no direction"
        )
    return np.asarray(given / lengths[..., None])


def _of_file(material: WithFibres, file: FibreFile, key: str, count: int, dimension: int) -> Array:
    """Vectors of all cells from a file, whose shape fits mesh and material."""
    vectors = file.read()
    fewest, most = material.family_range
    shape = vectors.shape
    fits = vectors.ndim == 3 and (shape[0], shape[2]) == (count, dimension)
    if not fits or not fewest <= shape[1] <= most:
        families = f"{fewest}" if fewest == most else f"{fewest} to {most}"
        raise InputError(
            f"{key}.fibres.file' = '{file.file}': has shape {shape}, expected "
            f"({count}, {families}, {dimension}): cells, families, components"
        )
    return vectors
