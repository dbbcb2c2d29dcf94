"""One closed surface of triangles that are open, cut each other or lie badly.

The surface is that of the tetrahedra with which fTetWild fills the triangles (Hu et al. 2020, *ACM
Trans. Graph.* 39(4)). Inside is what they go round more than half, so that holes are closed and
bodies that overlap are one. Two runs lay other triangles; therefore the surface is a file.
"""

from __future__ import annotations

from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from datagen.mesh.files.surface_file import SUFFIXES, bodies_of
from datagen.needed import GMSH
from shared_schema.common.arguments import checked_arguments
from shared_schema.common.bodies.cells import outward_facets
from shared_schema.common.errors import InputError, WorkError, first_line
from shared_schema.common.files import require_writable
from shared_schema.common.solution_file import require_suffix
from shared_schema.tools.closed_surface import read_triangles

COARSE = 0.05  # size of the triangles over the diagonal, by default
MOVED = 0.05  # largest distance of the new surface from the old one, over the size


@checked_arguments
def repair(surface: Path | str, out: Path | str, *, size: float | None = None) -> int:
    """Make one closed surface of the triangles of a file.

    Parameters
    ----------
    surface : Path or str
        STL, OBJ or PLY.
    out : Path or str
        File to write, also in one of these formats.
    size : float, optional
        Length of the edges of the new triangles, roughly, in the unit of the file; a twentieth of
        the diagonal by default. The surface moves by a twentieth of it at most.

    Returns
    -------
    int
        Number of the new triangles.

    Raises
    ------
    InputError
        If the file holds no triangles, or they enclose nothing.
    WorkError
        If pytetwild is missing, or the new surface is not closed either.
    """
    path, target = Path(surface), Path(out)
    require_suffix(target, SUFFIXES)
    require_writable(target)
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        points, triangles = read_triangles(path)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    try:
        import meshio
        from pytetwild import tetrahedralize
    except ImportError as error:
        raise WorkError(f"a repair needs pytetwild ({first_line(error)}); {GMSH}") from None
    edge = COARSE if size is None else size / float(np.linalg.norm(np.ptp(points, axis=0)))
    if not 0 < edge <= 1:
        raise InputError(f"size {size:g}: expected more than 0, at most the diagonal", "size")
    with TemporaryDirectory() as folder, chdir(folder):  # fTetWild leaves files where it runs
        at, cells = tetrahedralize(
            points, triangles.astype(np.int32), edge_length_fac=edge, epsilon=MOVED * edge
        )
    if not len(cells):
        raise InputError(f"{path}: its triangles enclose nothing")
    at = at.astype(np.float32)  # as STL has it
    facets = outward_facets(at.astype(np.float64), cells.astype(np.int64), "tetra")
    try:
        bodies_of(at.astype(np.float64), facets)
    except ValueError as error:
        raise WorkError(f"{path}: fTetWild fails, expected another size ({error})") from None
    cells = [("triangle", facets.astype(np.int32))]
    meshio.Mesh(at, cells).write(target, file_format=target.suffix.lower()[1:])
    return len(facets)
