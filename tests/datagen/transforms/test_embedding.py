"""Grids embedded on meshes: linear fields exactly, others to second order."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.cases.case import SHIPPED, read_case
from datagen.farm.farm import run
from datagen.mesh.geometries import Box
from datagen.mesh.mesh_file import MeshFile
from datagen.transforms.grid_choice import element_size, embed, finer, multilinear
from datagen.transforms.reindexing import nodal_forces_of, structure
from shared_schema.checker import check_dataset
from shared_schema.common.bodies.cells import CELL_TYPES
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.bodies.reference_cells import shape_gradients, shape_values
from shared_schema.common.command_line import logged
from shared_schema.common.errors import InputError
from shared_schema.grid import Grid, grid_of
from shared_schema.manifest import StructuredInfo
from shared_schema.points_in_cells import locate
from shared_schema.shard import read_shard

CUBE = """SetFactory("OpenCASCADE"); Box(1) = {{0, 0, 0, 2, 1, 1}};
Cylinder(2) = {{1, 0, 0.5, 0, 1, 0, 0.3}};
BooleanDifference(3) = {{ Volume{{1}}; Delete; }}{{ Volume{{2}}; Delete; }};
Mesh.MeshSizeMax = {size}; Mesh.MeshSizeMin = {size};
"""


def plate(refinement: float = 1.0, folder: Path = SHIPPED) -> RawMesh:
    script = (SHIPPED / "plate_with_holes.geo").read_text()
    if refinement != 1.0:
        script = script.replace("0.16;", f"{0.16 / refinement};")
        (folder / "plate_with_holes.geo").write_text(script)
    return MeshFile(kind="file", path="plate_with_holes.geo").found_from(folder).raw_mesh()


def cube(folder: Path) -> RawMesh:
    (folder / "cube.geo").write_text(CUBE.format(size=0.3))
    return MeshFile(kind="file", path="cube.geo").found_from(folder).raw_mesh()


def distorted_box(dimension: int) -> RawMesh:
    upper = (2.0, 1.0, 1.0)[:dimension]
    mesh = Box(lower=(0.0,) * dimension, upper=upper, elements=(6, 4, 4)[:dimension]).raw_mesh()
    inner = np.all((mesh.coordinates > 1e-9) & (mesh.coordinates < np.array(upper) - 1e-9), axis=1)
    moves = np.random.default_rng(3).uniform(-0.06, 0.06, mesh.coordinates.shape)
    return RawMesh(mesh.coordinates + inner[:, None] * moves, mesh.cells, mesh.cell_type)


@pytest.fixture(params=["triangle", "tetra", "quad", "hexahedron"], scope="module")
def mesh(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> RawMesh:
    """A mesh of every type of cell, two of them with holes, two with distorted cells."""
    makers: dict[str, Callable[[], RawMesh]] = {
        "triangle": plate,
        "tetra": lambda: cube(tmp_path_factory.mktemp("cube")),
        "quad": lambda: distorted_box(2),
        "hexahedron": lambda: distorted_box(3),
    }
    made = makers[request.param]()
    assert made.cell_type == request.param
    return made


def embedded(mesh: RawMesh, shape: tuple[int, ...] | None = None) -> Grid:
    return embed(mesh.coordinates, mesh.cells, mesh.cell_type, shape)


def test_linear_fields_go_there_and_back(mesh: RawMesh) -> None:
    """Also where a grid point lies outside of the body, in a hole: u = a + C x."""
    x, d = mesh.coordinates, mesh.coordinates.shape[1]
    rng = np.random.default_rng(0)
    u = rng.normal(size=d) + x @ rng.normal(size=(d, d))
    grid = embedded(mesh)
    assert grid.to_nodes(grid.to_grid(u)) == pytest.approx(u, abs=1e-10)
    step = np.ptp(x, axis=0) / (np.array(grid.shape) - 1)
    at = x.min(axis=0) + np.argwhere(grid.mask) * step
    assert pytest.approx(at, abs=1e-10) == grid.to_grid(x)[:, grid.mask].T


def test_forces_keep_resultant_and_moment(mesh: RawMesh) -> None:
    """Work under every rigid motion is kept, since B is exact for linear fields."""
    x, d = mesh.coordinates, mesh.coordinates.shape[1]
    f = np.random.default_rng(1).normal(size=x.shape)
    grid = embedded(mesh)
    on_grid = grid.forces_to_grid(f)[:, grid.mask]
    at = grid.to_grid(x)[:, grid.mask]
    assert on_grid.sum(axis=1) == pytest.approx(f.sum(axis=0))
    for a, b in [(0, 1), (0, 2), (1, 2)][: 1 if d == 2 else 3]:
        moment = x[:, a] @ f[:, b] - x[:, b] @ f[:, a]
        assert at[a] @ on_grid[b] - at[b] @ on_grid[a] == pytest.approx(moment)


def test_curved_fields_to_second_order(tmp_path: Path) -> None:
    """Element and grid size halved: the round trip's error falls by four."""
    errors = []
    for refinement in (1.0, 2.0, 4.0):
        mesh = plate(refinement, SHIPPED if refinement == 1.0 else tmp_path)
        x = mesh.coordinates
        u = np.stack([np.sin(2 * x[:, 0]) * x[:, 1], np.cos(x[:, 0] + 2 * x[:, 1])], axis=1)
        grid = embedded(mesh)
        errors.append(np.linalg.norm(grid.to_nodes(grid.to_grid(u)) - u) / np.linalg.norm(u))
    orders = -np.diff(np.log2(errors))
    assert np.all(orders > 1.7)
    assert errors[0] < 0.02


def test_grid_is_as_fine_as_the_mesh() -> None:
    """4 x 1.6 m in triangles of 0.16 m: some 26 x 10 steps, and no value inside the holes."""
    mesh = plate()
    assert element_size(mesh.coordinates, mesh.cells) == pytest.approx(0.16, rel=0.1)
    grid = embedded(mesh)
    assert grid.shape == (27, 11)
    assert not grid.mask.all()
    assert embedded(mesh, (9, 5)).shape == (9, 5)


def test_multilinear_by_hand() -> None:
    """A quarter of a step along x, half a step along y; and a point at the upper corner."""
    points, weights = multilinear(np.array([[1.25, 0.5], [3.0, 1.0]]), (4, 2))
    assert points.tolist() == [[2, 3, 4, 5], [4, 5, 6, 7]]
    assert weights.tolist() == [[0.375, 0.375, 0.125, 0.125], [0, 0, 0, 1]]


@pytest.mark.parametrize("cell_type", CELL_TYPES)
def test_shape_functions(cell_type: str) -> None:
    """One at their own corner, zero at the others, in VTK order; ΣN = 1; gradients."""
    square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    corners: NDArray[np.float64] = np.array(
        {
            "triangle": [[0, 0], [1, 0], [0, 1]],
            "quad": square,
            "tetra": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
            "hexahedron": [[*xy, z] for z in (0, 1) for xy in square],
        }[cell_type],
        dtype=np.float64,
    )
    assert shape_values(cell_type, corners) == pytest.approx(np.eye(len(corners)), abs=1e-14)
    xi = np.full((1, corners.shape[1]), 0.21)
    value, gradient = shape_values(cell_type, xi), shape_gradients(cell_type, xi)
    assert value.sum() == pytest.approx(1)
    for axis in range(corners.shape[1]):
        step = np.zeros_like(xi)
        step[0, axis] = 1e-6
        ahead, behind = (shape_values(cell_type, xi + s) for s in (step, -step))
        assert (ahead - behind) / 2e-6 == pytest.approx(gradient[:, :, axis], abs=1e-8)


def test_positions_are_found_in_their_cell(mesh: RawMesh) -> None:
    """Random points of cells, and the nodes themselves, lie in a cell with these coordinates."""
    rng = np.random.default_rng(2)
    weights = rng.dirichlet(np.ones(mesh.cells.shape[1]), size=len(mesh.cells))
    inside = np.einsum("nc,ncd->nd", weights, mesh.coordinates[mesh.cells])
    for positions in (inside, mesh.coordinates):
        cell, found, outside = locate(positions, mesh.coordinates, mesh.cells, mesh.cell_type)
        assert outside.max() < 1e-9
        back = np.einsum("nc,ncd->nd", found, mesh.coordinates[mesh.cells[cell]])
        assert back == pytest.approx(positions, abs=1e-9)


@pytest.fixture(scope="module")
def plate_dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plate") / "nodal"
    run(read_case("plate2d", samples=24), folder, comm=MPI.COMM_SELF)
    return folder


def test_structured_dataset_of_a_mesh_without_order(plate_dataset: Path, tmp_path: Path) -> None:
    manifest = structure(plate_dataset, tmp_path / "grid")
    assert check_dataset(tmp_path / "grid") == []
    info = manifest.structured
    assert info is not None
    assert info.embedding is not None
    nodal = read_shard(plate_dataset / "shard-00000.h5", "nodal")
    shard = read_shard(tmp_path / "grid" / "shard-00000.h5", "structured")
    u = nodal["samples/displacement"]
    assert np.array_equal(shard["samples/nodal_displacement"], u.astype(np.float32))
    grid = grid_of(shard)
    back = grid.to_nodes(shard["samples/displacement"].astype(np.float64))
    errors = [
        math.dist(a.ravel(), b.ravel()) / np.linalg.norm(b) for a, b in zip(back, u, strict=True)
    ]
    assert info.embedding.mean_error == pytest.approx(np.mean(errors), rel=1e-3)
    assert info.embedding.max_error == pytest.approx(np.max(errors), rel=1e-3)
    assert info.embedding.max_error < 0.03
    force = nodal_forces_of(nodal).sum(axis=1)
    assert shard["samples/force"].sum(axis=(2, 3)) == pytest.approx(force, abs=1e-6)


def test_a_grid_of_ones_own(plate_dataset: Path, tmp_path: Path) -> None:
    """Another shape is made again, the same is left alone."""
    first = structure(plate_dataset, tmp_path / "grid", grid=(20, 9))
    assert first.structured is not None
    assert first.structured.grid_shape == (20, 9)
    before = (tmp_path / "grid" / "shard-00000.h5").stat().st_mtime_ns
    assert structure(plate_dataset, tmp_path / "grid", grid=(20, 9)) == first
    assert (tmp_path / "grid" / "shard-00000.h5").stat().st_mtime_ns == before
    assert structure(plate_dataset, tmp_path / "grid").structured != first.structured
    assert check_dataset(tmp_path / "grid") == []


def test_a_grid_by_its_error(
    plate_dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first of 27 × 11, 33 × 13, 41 × 16, … points that is within the bound; it is said."""
    with logged("datagen"):
        default = structure(plate_dataset, tmp_path / "default").structured
    said = capsys.readouterr().err
    assert default is not None
    assert default.embedding is not None
    bound = 0.4 * default.embedding.mean_error
    chosen = structure(plate_dataset, tmp_path / "chosen", error=bound).structured
    assert chosen is not None
    assert chosen.embedding is not None
    assert chosen.embedding.mean_error <= bound
    tried: list[StructuredInfo | None] = [default]
    shape = finer(default.grid_shape)
    while shape != chosen.grid_shape:
        tried.append(structure(plate_dataset, tmp_path / str(shape), grid=shape).structured)
        shape = finer(shape)
    for coarser in tried:
        assert coarser is not None
        assert coarser.embedding is not None
        assert coarser.embedding.mean_error > bound
    assert tried[1] is not None
    assert tried[1].embedding is not None
    assert f"by {100 * tried[1].embedding.mean_error:.2f}% in the mean (--grid 33,13)" in said


def test_a_mesh_with_an_order_needs_no_grid(tmp_path: Path) -> None:
    """Its own has no error at all."""
    run(read_case("beam2d", samples=2), tmp_path / "nodal", comm=MPI.COMM_SELF)
    info = structure(tmp_path / "nodal", tmp_path / "grid", error=0.01).structured
    assert info is not None
    assert info.embedding is None


def test_what_fits_no_embedded_grid(plate_dataset: Path, tmp_path: Path) -> None:
    for wrong, words in (
        ({"order": "random"}, "--order random: 302 nodes on a grid of"),
        ({"order": "gmsh", "grid": (20, 9)}, "an embedded grid"),
        ({"grid": (20,)}, "expected 2 numbers of grid points"),
        ({"grid": (20, 1)}, "at least 2"),
        ({"grid": (20, 9), "error": 0.01}, "--error 0.01: expected without --grid"),
        ({"error": 0.0}, "--error 0: expected a number between 0 and 1"),
        ({"error": 1e-9}, "points for each node at most, still has"),
    ):
        with pytest.raises(InputError, match=words):
            structure(plate_dataset, tmp_path / "grid", **wrong)
    assert list(tmp_path.iterdir()) == []
