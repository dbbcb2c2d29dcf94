"""Mesh files of users: gmsh scripts and meshes, and other formats."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gmsh
import meshio
import numpy as np
import pytest
import yaml
from mpi4py import MPI

from datagen.cases.body import Body, make_body
from datagen.cases.case import SHIPPED, Case, read_case
from datagen.farm.farm import run
from datagen.mesh import distributed
from datagen.mesh.mesh_file import MeshFile
from datagen.mesh.raw_mesh import raw_mesh
from datagen.solver.load_stepping import solve_load_case
from shared_schema.common.bodies.cells import NEIGHBOURS
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.errors import InputError
from tests.datagen.farm_runs import assert_near, execute
from tests.datagen.refusal import refusal

SQUARE = """SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 2, 1};
Physical Curve("left") = {4}; Physical Curve("right") = {2}; Physical Curve(7) = {1, 2};
Mesh.MeshSizeMax = 0.3;
"""
BLOCK = """SetFactory("OpenCASCADE"); Box(1) = {0, 0, 0, 2, 1, 1};
Physical Surface("left") = {1}; Physical Surface("right") = {2};
Mesh.MeshSizeMax = 0.4;
"""
BRICKS = "Transfinite Curve {:} = 4; Transfinite Surface {:}; Recombine Surface {:};\n"
SCRIPTS = {
    "triangle": SQUARE,
    "quad": SQUARE + BRICKS,
    "tetra": BLOCK,
    "hexahedron": BLOCK + BRICKS + "Transfinite Volume {:};\n",
}
CASE: dict[str, Any] = {
    "name": "own",
    "mesh": {"kind": "file", "path": "own.geo"},
    "material": {"young_modulus": 500, "poisson_ratio": 0.4},
    "supports": [{"group": "left"}],
    "load": {"family": "random_node", "region": {"group": "right"}, "range": [-1, 1]},
    "dataset": {"samples": 8, "seed": 1, "shard_size": 4},
}


def write_case(folder: Path, script: str, **changes: Any) -> str:
    (folder / "own.geo").write_text(script)
    path = folder / "own.yaml"
    path.write_text(yaml.safe_dump(CASE | changes))
    return str(path)


def body_of(case: Case) -> Body:
    return make_body(case, MPI.COMM_SELF)


def mesh_at(path: Path) -> RawMesh:
    return MeshFile(kind="file", path=path.name).found_from(path.parent).raw_mesh()


def volume(mesh: RawMesh) -> float:
    """Area or volume: sum of |det| over the simplices that every cell is divided into."""
    corners = mesh.coordinates[mesh.cells]
    cuts: dict[str, list[tuple[int, ...]]] = {
        "triangle": [(1, 2)],
        "quad": [(1, 2), (2, 3)],
        "tetra": [(1, 2, 3)],
        "hexahedron": [(1, 2, 6), (2, 3, 6), (3, 7, 6), (7, 4, 6), (4, 5, 6), (5, 1, 6)],
    }
    total = sum(
        np.abs(np.linalg.det(corners[:, list(cut)] - corners[:, :1])).sum()
        for cut in cuts[mesh.cell_type]
    )
    return float(total) / math.factorial(mesh.coordinates.shape[1])


@pytest.mark.parametrize("cell_type", SCRIPTS)
def test_a_script_is_meshed(cell_type: str, tmp_path: Path) -> None:
    """The area or volume is 2; groups hold the nodes of their side, corners included."""
    (tmp_path / "own.geo").write_text(SCRIPTS[cell_type])
    mesh = mesh_at(tmp_path / "own.geo")
    assert mesh.cell_type == cell_type
    assert volume(mesh) == pytest.approx(2.0)
    x = mesh.coordinates
    assert np.array_equal(mesh.groups["left"], np.flatnonzero(x[:, 0] < 1e-9))
    assert np.array_equal(mesh.groups["right"], np.flatnonzero(x[:, 0] > 2 - 1e-9))
    if x.shape[1] == 2:
        edges = (x[:, 1] < 1e-9) | (x[:, 0] > 2 - 1e-9)
        assert np.array_equal(mesh.groups["7"], np.flatnonzero(edges))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("suffix", "cell_type"),
    [(".msh", "tetra"), (".vtu", "hexahedron"), (".xdmf", "triangle"), (".inp", "quad")],
)
def test_other_formats_hold_the_same_mesh(cell_type: str, suffix: str, tmp_path: Path) -> None:
    (tmp_path / "own.geo").write_text(SCRIPTS[cell_type])
    ours = mesh_at(tmp_path / "own.geo")
    path = tmp_path / f"own{suffix}"
    if suffix == ".msh":
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "own.geo"))
        gmsh.model.mesh.generate(ours.coordinates.shape[1])
        gmsh.option.setNumber("Mesh.SaveAll", 1)
        gmsh.write(str(path))
        gmsh.finalize()
    else:
        sets: dict[str, Any] = {name: ours.groups[name] for name in ("left", "right")}
        points = np.pad(ours.coordinates, ((0, 0), (0, 3 - ours.coordinates.shape[1])))
        point_sets = sets if suffix == ".inp" else None
        meshio.Mesh(points, [(cell_type, ours.cells)], point_sets=point_sets).write(path)
    read = mesh_at(path)
    assert read.cell_type == cell_type
    assert read.coordinates == pytest.approx(ours.coordinates)
    assert np.array_equal(read.cells, ours.cells)
    if suffix in (".msh", ".inp"):
        assert np.array_equal(read.groups["left"], ours.groups["left"])


@pytest.mark.parametrize("cell_type", SCRIPTS)
def test_reactions_balance_the_load(cell_type: str, tmp_path: Path) -> None:
    case = read_case(write_case(tmp_path, SCRIPTS[cell_type]))
    body = body_of(case)
    load = case.loads[0].draw(3, 1, body.loads.loadable)
    report = solve_load_case(body.problem, load.nodes, load.forces, case.solver)
    assert report.solved
    reactions = body.problem.reactions()
    assert reactions[body.clamped].sum(axis=0) == pytest.approx(-load.forces.sum(axis=0), abs=1e-7)
    assert np.abs(reactions[~body.clamped]).max() < 1e-8


def test_finer_triangles_come_near_the_quadrilaterals(tmp_path: Path) -> None:
    """The tip of a cantilever under an end load moves equally with both types of cells."""
    tips = []
    for cell_type, fine in (("quad", " = 4;"), ("triangle", "0.3")):
        script = SCRIPTS[cell_type].replace(fine, {" = 4;": " = 33;", "0.3": "0.03"}[fine])
        load = {"family": "traction", "region": {"group": "right"}, "range": [-1, 1]}
        case = read_case(write_case(tmp_path, script, load=load))
        body = body_of(case)
        sides = case.loads[0].draw(0, 0, body.loads.loadable)
        down = np.outer(np.abs(sides.forces[:, 1]) / np.abs(sides.forces[:, 1]).sum(), [0.0, -10.0])
        assert solve_load_case(body.problem, sides.nodes, down, case.solver).solved
        corner = np.linalg.norm(body.mesh.coordinates - [2, 0], axis=1).argmin()
        tips.append(body.problem.displacement()[corner, 1])
    assert tips[0] == pytest.approx(tips[1], rel=0.01)
    assert abs(tips[0]) > 0.2


def test_two_groups_of_cells_are_one_body(tmp_path: Path) -> None:
    """If cells are in physical groups, the mesh consists of these cells and their nodes only."""
    script = """SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 1, 1};
    Rectangle(2) = {1, 0, 0, 1, 1}; Rectangle(3) = {5, 0, 0, 1, 1}; Coherence;
    Physical Surface("body") = {1, 2}; Mesh.MeshSizeMax = 0.5;
"""
    (tmp_path / "own.geo").write_text(script)
    mesh = mesh_at(tmp_path / "own.geo")
    assert volume(mesh) == pytest.approx(2.0)
    assert mesh.coordinates[:, 0].max() == pytest.approx(2.0)
    assert len(mesh.groups["body"]) == len(mesh.coordinates)


def unit_square(**changes: Any) -> tuple[Any, Any, Any]:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [9, 9, 9]])
    blocks = [("quad", np.array([[0, 1, 2, 3]]))]
    content: dict[str, Any] = {"points": points, "blocks": blocks, "groups": {}} | changes
    return content["points"], content["blocks"], content["groups"]


def test_nodes_without_cells_are_left_out() -> None:
    mesh = raw_mesh(*unit_square(groups={(0, "all"): np.array([4, 2, 0])}))
    assert len(mesh.coordinates) == 4
    assert mesh.groups["all"].tolist() == [0, 2]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"blocks": []}, "cells are none"),
        ({"blocks": [("line", np.array([[0, 1]]))]}, "cells are none"),
        ({"blocks": [("triangle6", np.zeros((1, 6), dtype=int))]}, "cells are triangle6"),
        (
            {"blocks": [("quad", np.array([[0, 1, 2, 3]])), ("triangle", np.array([[0, 1, 2]]))]},
            "cells are quad, triangle",
        ),
        ({"blocks": [("quad", np.array([[0, 2, 1, 3]]))]}, "flat or turned over"),
        ({"blocks": [("triangle", np.array([[0, 1, 1]]))]}, "flat or turned over"),
        ({"points": np.full((5, 3), np.nan)}, "NaN"),
        ({"points": np.eye(5, 3) + 1.0}, "leaves the plane"),
    ],
)
def test_unfit_meshes_are_named(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        raw_mesh(*unit_square(**change))


def written(folder: Path, points: Any, cells: Any, cell_type: str = "triangle") -> Path:
    """Mesh file, and a case of it that holds the side x = 0."""
    space = np.pad(np.asarray(points, dtype=float), ((0, 0), (0, 3 - len(points[0]))))
    meshio.Mesh(space, [(cell_type, np.asarray(cells))]).write(folder / "own.vtu")
    place = {"mesh": {"kind": "file", "path": "own.vtu"}, "supports": [{"x": 0}]}
    load = {"family": "random_node", "region": {"x": "> 0"}, "range": [-1, 1]}
    path = folder / "own.yaml"
    path.write_text(yaml.safe_dump(CASE | place | {"load": load}))
    return path


PLATE = [[0.0, 0], [1, 0], [1, 1], [0, 1]]
HALVES = [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize(
    ("points", "cells", "said"),
    [
        (PLATE, [*HALVES, [2, 0, 1]], "cells 0, 2: the same nodes, expected each cell once"),
        ([*PLATE, [1, -1]], [*HALVES, [0, 2, 4]], "cells 0, 1, 2: more than two share a facet"),
        ([*PLATE[:3], [0.9, 0.5]], HALVES, "cell 1: turned over, on the same side of a facet"),
        (
            [*PLATE, [0, 0.3], [0.3, 0.45], [0, 0.6]],
            [*HALVES, [4, 5, 6]],
            "cells 1, 2: they overlap (cell 1 at 0.333333,0.666667 lies over cell 2)",
        ),
        (PLATE, [[0, 1, 2], [0, 2, 7]], "cell 1: a node outside 0 … 3"),
        ([[0.0, 0]], np.zeros((0, 3), dtype=int), "meshio finds no mesh with cells"),
    ],
)
def test_cells_that_are_no_body(
    points: Any, cells: Any, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """dolfinx damages its memory over the first two; the half-turned third was solved."""
    path, out = written(tmp_path, points, cells), str(tmp_path / "out.npz")
    found = refusal(["solve", str(path), "--load", "1,0:0,-1", "--out", out], capsys)
    assert f"key 'mesh.path' = 'own.vtu': {said}" in found


def test_a_mesh_that_is_turned_as_a_whole(tmp_path: Path) -> None:
    """Clockwise triangles are the same body: energy and forces as of the other numbering."""
    energies = []
    for cells in (HALVES, [cell[::-1] for cell in HALVES], [HALVES[0], HALVES[1][::-1]]):
        body = body_of(read_case(str(written(tmp_path, PLATE, cells))))
        body.problem.set_load(np.array([0]), np.zeros((1, 2)))
        body.problem.set_displacement(body.mesh.coordinates * [0.2, 0.1])
        energies.append(body.problem.energy())
    assert energies == pytest.approx([energies[0]] * 3)
    assert energies[0] > 1


@pytest.mark.slow
@pytest.mark.mpi
def test_two_ranks_refuse_a_repeated_cell(tmp_path: Path) -> None:
    path = written(tmp_path, PLATE, [*HALVES, HALVES[0]])
    result = execute(2, path, tmp_path / "out", "--ranks-per-solve", "2")
    assert result.returncode == 2
    assert "cells 0, 2: the same nodes, expected each cell once" in result.stderr


def test_arrays_that_dolfinx_would_not_survive() -> None:
    """Whatever the way by which a mesh comes, it is looked at before dolfinx is."""
    raw = RawMesh(np.array(PLATE), np.array([*HALVES, HALVES[0]]), "triangle")
    with pytest.raises(InputError, match="mesh: cells 0, 2: the same nodes"):
        distributed(raw, MPI.COMM_SELF)


def test_neighbours_of_corners_are_right_handed() -> None:
    """Cells in VTK order have positive Jacobians at every corner, unless they are turned over."""
    square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    cells: dict[str, Any] = {
        "triangle": [[0, 0], [1, 0], [0, 1]],
        "quad": square,
        "tetra": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "hexahedron": [[*xy, z] for z in (0, 1) for xy in square],
    }
    for name, corners in cells.items():
        x = np.asarray(corners, dtype=float)
        for corner, neighbours in enumerate(NEIGHBOURS[name]):
            assert np.linalg.det(x[list(neighbours)] - x[corner]) == pytest.approx(1.0), name


Change = Callable[[Path], str]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: write_case(f, SQUARE, mesh={"kind": "file", "path": "no.geo"}), "no such file"),
        (lambda f: write_case(f, SQUARE.rstrip()), "expected a line feed at the end"),
        (lambda f: write_case(f, "Rectangle(1) = {0, 0;\n"), "key 'mesh.path' = 'own.geo': "),
        (lambda f: write_case(f, SQUARE + "Mesh.ElementOrder = 2;\n"), "cells are Triangle 6"),
        (
            lambda f: write_case(f, SQUARE, supports=[{"group": "lift"}]),
            r"key 'supports.0': group 'lift': the mesh has no such group, but 7, left, right",
        ),
        (
            lambda f: write_case(f, SQUARE + "Rectangle(2) = {5, 0, 0, 1, 1};\n"),
            r"key 'supports': \d+ nodes are not connected to a clamped one, the first at 5",
        ),
        (
            lambda f: write_case(f, SQUARE, supports=[{"group": "left", "y": "> 3"}]),
            r"key 'supports\.0': no node of the mesh lies there",
        ),
    ],
)
def test_errors_of_a_case_are_named(change: Change, words: str, tmp_path: Path) -> None:
    path = change(tmp_path)
    with pytest.raises(InputError, match=words):
        body_of(read_case(path))


@pytest.mark.parametrize("name", ["own.stl", "own.txt", "own.vtu"])
def test_files_that_hold_no_mesh(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("no mesh")
    with pytest.raises(InputError, match=f"key 'mesh.path' = '{name}': "):
        mesh_at(tmp_path / name)


ABORT = """
Point(1) = {0, 0, 0, 0.3}; Point(2) = {1, 0, 0, 0.3}; Point(3) = {1, 1, 0, 0.3};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 1};
Curve Loop(1) = {1, 2, 3}; Plane Surface(1) = {1};
Field[1] = ExternalProcess; Field[1].CommandLine = "cat"; Background Field = 1;
"""


@pytest.mark.parametrize(
    ("script", "said"),
    [
        (ABORT, "(SIGABRT|Wrong mesh element size)"),
        ("Exit;\n", "exit code 0"),
        ("", "cells are none"),
    ],
)
def test_a_file_that_ends_gmsh(script: str, said: str, tmp_path: Path) -> None:
    """gmsh 4.8 aborts over an element size of 0; the process that reads the file ends, not ours."""
    (tmp_path / "own.geo").write_text(script + "\n")
    with pytest.raises(InputError, match=f"'own.geo': .*{said}"):
        MeshFile(kind="file", path="own.geo").found_from(tmp_path, trust=True).raw_mesh()


def test_a_dataset_belongs_to_one_mesh(tmp_path: Path) -> None:
    """The checksum of the file is part of the case: another mesh is another case."""
    path = write_case(tmp_path, SQUARE)
    run(read_case(path), tmp_path / "nodal", comm=MPI.COMM_SELF)
    write_case(tmp_path, SQUARE + "// a word\n")
    with pytest.raises(
        InputError, match=r"another case: the file of mesh.path = 'own.geo' has changed"
    ):
        run(read_case(path), tmp_path / "nodal", comm=MPI.COMM_SELF)


def test_the_case_may_name_the_checksum(tmp_path: Path) -> None:
    wrong = {"kind": "file", "path": "own.geo", "sha256": "0" * 64}
    with pytest.raises(InputError, match=r"key 'mesh\.sha256'"):
        read_case(write_case(tmp_path, SQUARE, mesh=wrong))


def test_the_shipped_plate() -> None:
    """4 x 1.6 m less three holes: 6.4 − π (0.4² + 0.45² + 0.35²), polygons for circles."""
    mesh = MeshFile(kind="file", path="plate_with_holes.geo").found_from(SHIPPED).raw_mesh()
    area = 6.4 - math.pi * (0.4**2 + 0.45**2 + 0.35**2)
    assert volume(mesh) == pytest.approx(area, rel=0.01)
    body = body_of(read_case("plate2d"))
    assert (body.clamped.sum(), body.loadable.sum()) == (11, 11)


@pytest.mark.slow
@pytest.mark.mpi
def test_two_ranks_share_a_mesh_from_a_file(tmp_path: Path) -> None:
    """On two ranks groups and sample numbers are the same; displacements agree to 1e-10 m."""
    path = write_case(tmp_path, SCRIPTS["tetra"])
    run(read_case(path), tmp_path / "one", comm=MPI.COMM_SELF)
    result = execute(2, Path(path), tmp_path / "two", "--ranks-per-solve", "2")
    assert result.returncode == 0, result.stderr
    assert_near(tmp_path / "one", tmp_path / "two")


def test_coordinates_of_a_file_are_scaled(tmp_path: Path) -> None:
    """A script in mm becomes a body in m; a factor of 1 leaves the case's digest alone."""
    mesh = {"kind": "file", "path": "own.geo"}
    plain = read_case(write_case(tmp_path, SQUARE))
    scaled = read_case(write_case(tmp_path, SQUARE, mesh=mesh | {"scale": 1e-3}))
    found, expected = scaled.mesh.raw_mesh(), plain.mesh.raw_mesh()
    np.testing.assert_array_equal(found.coordinates, 1e-3 * expected.coordinates)
    np.testing.assert_array_equal(found.cells, expected.cells)
    assert scaled.plain()["mesh"]["scale"] == 1e-3
    assert "scale" not in plain.plain()["mesh"]
    unit = read_case(write_case(tmp_path, SQUARE, mesh=mesh | {"scale": 1}))
    assert unit.digest() == plain.digest()


@pytest.mark.parametrize("scale", [0, -1, "mm"])
def test_a_scale_is_a_positive_number(tmp_path: Path, scale: Any) -> None:
    mesh = {"kind": "file", "path": "own.geo", "scale": scale}
    with pytest.raises(InputError, match=r"mesh.*scale"):
        read_case(write_case(tmp_path, SQUARE, mesh=mesh))
