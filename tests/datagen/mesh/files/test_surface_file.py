"""Surfaces of triangles (STL, OBJ, PLY), which gmsh fills with tetrahedra."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from datagen.cases.case import read_case
from datagen.mesh.mesh_file import MeshFile
from shared_schema.common.bodies.cells import outward_facets
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.errors import InputError
from tests.closed_surfaces import CUBE, FACES, surface_file
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


@pytest.mark.parametrize("name", ["own.stl", "own.obj", "own.PLY"])
def test_formats(name: str, tmp_path: Path) -> None:
    """A cube of 1 m³, also of quadrilaterals where the format has them."""
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    for cells in ([("triangle", FACES)], [("quad", np.array(quads))])[: 1 + (".PLY" in name)]:
        meshio.Mesh(CUBE, cells).write(tmp_path / name.lower())
        (tmp_path / name.lower()).rename(tmp_path / name)
        mesh = MeshFile(kind="file", path=name).found_from(tmp_path).raw_mesh()
        assert (mesh.cell_type, len(boundary_nodes(mesh))) == ("tetra", 8)
        assert volume(mesh) == pytest.approx(1, rel=1e-12)
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"
    (tmp_path / "open.obj").write_text(text)
    with pytest.raises(InputError, match="the surface is not closed: 4 of its 5 edges"):
        MeshFile(kind="file", path="open.obj").found_from(tmp_path).raw_mesh()


def test_a_bad_triangle_is_laid_anew(tmp_path: Path) -> None:
    """A triangle of 1 m × 1 nm makes a flat cell; the error names what replaces it."""
    a, b, c = FACES[0]
    beside = CUBE[a] + 0.5 * (CUBE[b] - CUBE[a]) + 1e-9 * (CUBE[c] - CUBE[a])
    new = [[a, b, len(CUBE)], [b, c, len(CUBE)], [c, a, len(CUBE)]]
    surface_file(tmp_path / "own.ply", np.vstack([CUBE, beside]), np.vstack([FACES[1:], new]))
    wanted = MeshFile(kind="file", path="own.ply").found_from(tmp_path)
    with pytest.raises(InputError, match=r"flat or turned over .*; 'size' lays other triangles on"):
        wanted.raw_mesh()
    other = MeshFile(kind="file", path="own.ply", size=0.5).found_from(tmp_path).raw_mesh()
    assert volume(other) == pytest.approx(1, rel=0.1)  # edges are cut


def boundary_nodes(mesh: RawMesh) -> np.ndarray:
    return np.unique(outward_facets(mesh.coordinates, mesh.cells, mesh.cell_type))


def test_a_surface_with_a_hole(surface: np.ndarray, tmp_path: Path) -> None:
    write_stl(tmp_path / "open.stl", surface[1:])
    wanted = MeshFile(kind="file", path="open.stl").found_from(tmp_path)
    with pytest.raises(InputError, match="the surface is not closed: 3 of its"):
        wanted.raw_mesh()
    (tmp_path / "open.stl").write_text("solid nothing\nendsolid nothing\n")
    with pytest.raises(InputError, match=r"key 'mesh\.path' = 'open\.stl'"):
        MeshFile(kind="file", path="open.stl").found_from(tmp_path).raw_mesh()


def block(lower: tuple[float, ...], upper: tuple[float, ...], turned: bool = False) -> np.ndarray:
    """Triangles of a box, seen from outside, or from inside if turned."""
    corners = CUBE * (np.array(upper) - lower) + lower
    return corners[FACES[:, ::-1] if turned else FACES]


def inside(folder: Path, corners: list[np.ndarray], size: float | None = None) -> RawMesh:
    write_stl(folder / "own.stl", np.concatenate(corners))
    return MeshFile(kind="file", path="own.stl", size=size).found_from(folder).raw_mesh()


@pytest.mark.parametrize("size", [None, 0.7])
def test_a_closed_room_stays_empty(size: float | None, tmp_path: Path) -> None:
    """6 × 3 × 3 less 4 × 1 × 1 are 50 m³; in a larger room a block of 0.5 × 0.5 × 0.5 is a body.

    New triangles of 0.7 m cut the edges, by 2 % of the volume.
    """
    body = [block((0, 0, 0), (6, 3, 3)), block((1, 1, 1), (5, 2, 2), turned=True)]
    error = 1e-9 if size is None else 0.02
    assert volume(inside(tmp_path, body, size)) == pytest.approx(50, rel=error)
    island = block((2, 1.25, 1.25), (2.5, 1.75, 1.75))
    assert volume(inside(tmp_path, [*body, island], size)) == pytest.approx(50.125, rel=error)


@pytest.mark.parametrize("size", [None, 0.5])
def test_two_bodies_in_one_file(size: float | None, tmp_path: Path) -> None:
    """In one section or in two of a file; 2 m³ together, less what new triangles cut."""
    boxes = [block((0, 0, 0), (1, 1, 1)), block((2, 0, 0), (3, 1, 1))]
    one = inside(tmp_path, boxes, size)
    assert volume(one) == pytest.approx(2, rel=1e-9 if size is None else 0.05)
    texts = [write_stl(tmp_path / "part.stl", box).read_text() for box in boxes]
    (tmp_path / "own.stl").write_text("".join(texts))
    two = MeshFile(kind="file", path="own.stl", size=size).found_from(tmp_path).raw_mesh()
    np.testing.assert_array_equal(two.cells, one.cells)


@pytest.mark.parametrize(
    ("second", "said"),
    [
        (block((0.8, 0.2, 0.2), (1.7, 0.9, 0.7)), "the surface cuts itself at 1,0.[2-9]"),
        (block((0.5, 0.5, 0), (1.5, 1.5, 1)), "the surface cuts itself at "),
        (block((0.3, 0.3, 0.3), (0.6, 0.6, 0.6)), "at 0.3,0.3,0.3 lies in another one and is seen"),
        (block((1, 0, 0), (2, 1, 1)), "not closed: 5 of its 31 edges have another .* at 1,"),
    ],
)
def test_bodies_that_are_not_apart(second: np.ndarray, said: str, tmp_path: Path) -> None:
    """Pierced, flush with each other, one in the other without a room, and side to side."""
    with pytest.raises(InputError, match=f"key 'mesh.path' = 'own.stl': .*{said}"):
        inside(tmp_path, [block((0, 0, 0), (1, 1, 1)), second])
