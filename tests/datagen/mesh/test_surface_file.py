"""Surfaces of triangles (STL), which gmsh fills with tetrahedra."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from datagen.cases.case import read_case
from datagen.mesh.mesh_file import MeshFile
from datagen.mesh.raw_mesh import RawMesh
from shared_schema.common.bodies.cells import outward_facets
from shared_schema.common.errors import InputError
from tests.datagen.mesh.test_mesh_file import volume


def write_stl(path: Path, corners: np.ndarray) -> Path:
    """Write triangles, (n, 3, 3) in m, as text."""
    lines = ["solid body"]
    for triangle in corners:
        normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
        lines += ["facet normal {:g} {:g} {:g}".format(*normal), "outer loop"]
        lines += ["vertex {:.9g} {:.9g} {:.9g}".format(*corner) for corner in triangle]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid body"]) + "\n")
    return path


@pytest.fixture(scope="module")
def breast() -> RawMesh:
    return read_case("breast3d").mesh.raw_mesh()


@pytest.fixture(scope="module")
def surface(breast: RawMesh) -> np.ndarray:
    """Triangles of the breast's surface, seen from outside."""
    facets = outward_facets(breast.coordinates, breast.cells, breast.cell_type)
    return np.asarray(breast.coordinates[facets])


def test_triangles_of_the_file_stay(breast: RawMesh, surface: np.ndarray, tmp_path: Path) -> None:
    """The nodes of the surface are those of the file; the volume is that inside."""
    write_stl(tmp_path / "breast.stl", surface)
    mesh = MeshFile(kind="file", path="breast.stl").found_from(tmp_path).raw_mesh()
    assert mesh.cell_type == "tetra"
    facets = outward_facets(mesh.coordinates, mesh.cells, mesh.cell_type)
    assert len(facets) == len(surface)
    found = np.unique(mesh.coordinates[np.unique(facets)].round(8), axis=0)
    assert found == pytest.approx(np.unique(surface.reshape(-1, 3).round(8), axis=0), abs=1e-7)
    assert volume(mesh) == pytest.approx(volume(breast), rel=1e-6)


def test_others_of_a_given_size(breast: RawMesh, surface: np.ndarray, tmp_path: Path) -> None:
    """Half as large cells are some times as many; the volume is met to 2 and 4 %."""
    write_stl(tmp_path / "breast.STL", surface)
    counts = []
    for size in (0.02, 0.01):
        wanted = MeshFile(kind="file", path="breast.STL", size=size).found_from(tmp_path)
        mesh = wanted.raw_mesh()
        assert volume(mesh) == pytest.approx(volume(breast), rel=2 * size)  # edges are cut
        counts.append(len(mesh.cells))
    assert counts[1] > 3 * counts[0]


def test_a_surface_with_a_hole(surface: np.ndarray, tmp_path: Path) -> None:
    write_stl(tmp_path / "open.stl", surface[1:])
    wanted = MeshFile(kind="file", path="open.stl").found_from(tmp_path)
    with pytest.raises(InputError, match="the surface is not closed: 3 of its"):
        wanted.raw_mesh()
    (tmp_path / "open.stl").write_text("solid nothing\nendsolid nothing\n")
    with pytest.raises(InputError, match=r"key 'mesh\.path' = 'open\.stl'"):
        MeshFile(kind="file", path="open.stl").found_from(tmp_path).raw_mesh()
