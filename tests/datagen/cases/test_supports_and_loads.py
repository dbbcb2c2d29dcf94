"""Components held, loads of every kind, alone and at once, and bodies that are mechanisms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mpi4py import MPI
from scipy.integrate import trapezoid

from datagen import solve
from datagen.cases.body import Body, make_body
from datagen.cases.case import Case, read_case
from datagen.cases.rigid_motions import motion_problem
from datagen.command_line import main
from datagen.farm.farm import run
from datagen.solver.load_stepping import solve_load_case
from shared_schema.checker import check_dataset
from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.bodies.distributed_loads import cell_shares
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.bodies.nodal_forces import scatter_forces
from shared_schema.common.bodies.reference_cells import CORNERS
from shared_schema.common.errors import InputError
from shared_schema.dataset_reader import DatasetReader
from shared_schema.loads import Load
from shared_schema.shard import read_shard

ROLLING = [{"x": 0, "components": ["x"]}, {"x": 0, "y": 0}]
QUAD = np.array(CORNERS["quad"], float)
CUBE = np.array(CORNERS["hexahedron"], float)


def case_of(folder: Path, **keys: Any) -> Case:
    """A beam of 4 x 1 m with other supports, loads or materials."""
    content = yaml.safe_load(Path("datagen/configs/beam2d.yaml").read_text())
    content["dataset"] |= {"samples": 6, "shard_size": 3}
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(content | keys))
    return read_case(str(path))


def solved(body: Body, case: Case, load: Load) -> np.ndarray:
    drive = load.controls, load.displacement
    assert solve_load_case(body.problem, load.nodes, load.forces, case.solver, *drive).solved
    return body.problem.displacement()


# --- supports -------------------------------------------------------------------------------------


def test_symmetry_halves_a_body(tmp_path: Path) -> None:
    """Half of a beam, sliding on its middle, moves as the whole one does under both forces."""
    load = {"family": "each_node", "region": {"x": 4, "y": 1}, "force": [20.0, -3.0]}
    whole = case_of(
        tmp_path,
        supports=[{"x": 0}],
        mesh={"kind": "box", "lower": [0, -1], "upper": [4, 1], "elements": [12, 6]},
        load=[load, load | {"region": {"x": 4, "y": -1}, "force": [20.0, 3.0]}],
    )
    half = case_of(
        tmp_path,
        supports=[{"x": 0}, {"y": 0, "components": ["y"]}],
        mesh={"kind": "box", "lower": [0, 0], "upper": [4, 1], "elements": [12, 3]},
        load=load,
    )
    bodies = [make_body(case, MPI.COMM_SELF) for case in (whole, half)]
    u, v = (solved(b, c, b.loads[0]) for b, c in zip(bodies, (whole, half), strict=True))
    x, y = (body.mesh.coordinates for body in bodies)
    above = [int(np.linalg.norm(x - point, axis=1).argmin()) for point in y]
    assert v == pytest.approx(u[above], abs=1e-9)
    assert np.abs(v).max() > 0.1


@pytest.mark.parametrize(
    ("supports", "said"),
    [
        ([{"x": 0, "components": ["x"]}], "can still move or turn"),
        ([{"x": 0, "y": 0}], "can still move or turn"),
        ([{"x": 0, "components": ["z"]}], "the body is in the plane"),
        ([{"x": 0, "components": ["x", "x"]}], "each component once"),
        ([{"x": 0, "components": []}], "supports.0.components"),
        ([{"x": 0, "components": ["w"]}], "supports.0.components"),
    ],
)
def test_wrong_supports(tmp_path: Path, supports: Any, said: str) -> None:
    with pytest.raises(InputError) as error:
        make_body(case_of(tmp_path, supports=supports), MPI.COMM_SELF)
    assert said in str(error.value)


def test_no_force_on_a_held_component(tmp_path: Path) -> None:
    load = {"family": "random_node", "region": {"x": 0, "y": "> 0"}, "range": [-1, 1]}
    body = make_body(case_of(tmp_path, supports=ROLLING, load=load), MPI.COMM_SELF)
    for number in range(10):
        forces = body.loads[number].forces
        assert np.all(forces[:, 0] == 0)
        assert np.all(forces[:, 1] != 0)


# --- loads ----------------------------------------------------------------------------------------


def test_weight_of_a_hanging_bar(tmp_path: Path) -> None:
    """Without Poisson's effect P = μ (λ − 1/λ) = b (L − x), and u(L) = ∫ (λ − 1) dx.

    With 200 elements the error of the end's displacement is of the order h² = 4e-4 of it.
    """
    b = 60.0
    case = case_of(
        tmp_path,
        mesh={"kind": "box", "lower": [0, 0], "upper": [4, 0.1], "elements": [200, 1]},
        supports=[{"x": 0, "components": ["x"]}, {"y": 0, "components": ["y"]}],
        material={"young_modulus": 500, "poisson_ratio": 0.0, "volumetric": "quadratic"},
        load={"family": "body_force", "region": {}, "range": [b, b + 1e-9]},
    )
    body = make_body(case, MPI.COMM_SELF)
    load = body.loads[0]
    total = scatter_forces(load.nodes, load.forces, len(body.mesh.coordinates)).sum(axis=0)
    assert total[0] == pytest.approx(b * 4 * 0.1 * (1 - 0.5 / 200), rel=1e-6)  # the rest is held
    u = solved(body, case, load)
    x = np.linspace(0, 4, 100_001)
    p = b * (4 - x) / 250
    stretch = (p + np.sqrt(p**2 + 4)) / 2
    expected = trapezoid(stretch - 1, x)
    end = np.isclose(body.mesh.coordinates[:, 0], 4.0)
    assert u[end, 0] == pytest.approx(expected, rel=1e-4)


def test_solve_takes_a_body_force(tmp_path: Path) -> None:
    """Of b times the area 4 × 1 m; a load family of the same b gives the same displacement."""
    case = case_of(
        tmp_path,
        supports=[{"x": 0}],
        load={"family": "body_force", "range": [-2.0, -2.0 + 1e-12]},
    )
    body = make_body(case, MPI.COMM_SELF)
    expected = solved(body, case, body.loads[0])
    found = solve(case, body_force=(-2.0, -2.0))
    assert found.displacement == pytest.approx(expected, abs=1e-9)
    edge = np.unique(found.coordinates[:, 0])[1]  # half of its column of cells hangs on supports
    acting = np.array([-2.0, -2.0]) * (4.0 - edge / 2) * 1.0
    assert found.force.sum(axis=0) == pytest.approx(acting, rel=1e-12)
    assert found.reactions.sum(axis=0) == pytest.approx(-acting, abs=1e-6)
    out = tmp_path / "out.npz"
    words = ["solve", str(tmp_path / "case.yaml"), "--body-force", "-2,-2", "--out", str(out)]
    assert main(words) == 0
    assert np.load(out)["displacement"] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("load", "count"),
    [
        ({"family": "random_node", "range": [-1, 1]}, "free"),
        ({"family": "random_nodes", "range": [-1, 1], "count": [1, 3]}, "free"),
        ({"family": "body_force", "range": [-1, 1]}, "free"),
        ({"family": "traction", "range": [-1, 1]}, "surface"),
        ({"family": "pressure", "range": [0, 1]}, "surface"),
        ({"family": "traction_patch", "range": [-1, 1], "radius": 0.5}, "surface"),
    ],
)
def test_without_a_region_loads_act_everywhere(
    load: dict[str, Any], count: str, tmp_path: Path
) -> None:
    """On all free nodes, or those of the surface."""
    case = case_of(tmp_path, supports=[{"x": 0}], load=load)
    body = make_body(case, MPI.COMM_SELF)
    surface = np.zeros(len(body.mesh.coordinates), dtype=bool)
    surface[boundary_facets(body.mesh.cells, body.mesh.cell_type)] = True
    expected = ~body.clamped & (surface if count == "surface" else True)
    assert np.array_equal(body.loadable, expected)


def test_a_displacement_needs_a_region(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"key 'load\.region' is missing"):
        case_of(tmp_path, supports=[{"x": 0}], load={"family": "displacement", "range": [0, 1]})


def test_body_force_in_space_is_weight() -> None:
    """Sum of the nodal forces on all cells: b times the volume, in every kind of cell."""
    cube = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
    hexahedron = cube * [2.0, 1.0, 3.0] + 0.2 * cube[:, [1, 2, 0]]
    matrix = np.diag([2.0, 1.0, 3.0]) + 0.2 * np.eye(3)[:, [2, 0, 1]].T
    volume = abs(np.linalg.det(matrix))
    assert cell_shares(hexahedron[None]).sum() == pytest.approx(volume, rel=1e-12)
    assert cell_shares(hexahedron[None]) == pytest.approx(volume / 8, rel=1e-12)
    tetrahedron = hexahedron[[0, 1, 3, 4]]
    assert cell_shares(tetrahedron[None]) == pytest.approx(volume / 24, rel=1e-12)


def test_traction_on_a_face_that_touches_the_support(tmp_path: Path) -> None:
    """The nodes of the support bear their part: half an element's of 15."""
    load = {"family": "traction", "region": {"y": 1}, "range": [0.5, 0.5 + 1e-9]}
    body = make_body(case_of(tmp_path, load=load), MPI.COMM_SELF)
    assert body.loads[0].forces.sum(axis=0) == pytest.approx(2.0 * (1 - 0.5 / 15), rel=1e-6)


GRIP = {"family": "displacement", "region": {"x": 4}, "range": [0.05, 0.4]}
PRESS = {"family": "pressure", "region": {"y": 1}, "range": [1.0, 5.0]}
PUSH = {"family": "random_nodes", "region": {"y": 0, "x": "> 0"}, "range": [-0.5, 0.5]}


def test_reactions_hold_a_gripped_body(tmp_path: Path) -> None:
    """What a dataset holds as forces brings the free body to the same equilibrium."""
    gripped = case_of(tmp_path, load=GRIP)
    run(gripped, tmp_path / "nodal", comm=MPI.COMM_SELF)
    assert check_dataset(tmp_path / "nodal") == []
    names = ("samples/loaded_nodes", "samples/force", "samples/displacement")
    nodes, force, displacement = DatasetReader(tmp_path / "nodal").joined(names).values()
    free = make_body(read_case("beam2d"), MPI.COMM_SELF)
    for number in range(3):
        at_end = displacement[number][nodes[number]]
        assert at_end == pytest.approx(np.tile(at_end[0], (4, 1)), abs=1e-15)
        report = solve_load_case(free.problem, nodes[number], force[number], gripped.solver)
        assert report.solved
        assert free.problem.displacement() == pytest.approx(displacement[number], abs=1e-8)


def test_only_one_component_is_moved(tmp_path: Path) -> None:
    case = case_of(tmp_path, load=GRIP | {"components": ["y"]})
    body = make_body(case, MPI.COMM_SELF)
    u = solved(body, case, body.loads[1])
    end = np.isclose(body.mesh.coordinates[:, 0], 4.0)
    assert np.ptp(u[end, 1]) == pytest.approx(0, abs=1e-15)
    assert np.ptp(u[end, 0]) > 1e-3
    _, forces, _ = body.loads.recorded(body.loads[1], body.problem.grip())
    assert np.all(forces[:, 0] == 0)


def test_several_at_once(tmp_path: Path) -> None:
    """Forces of a sample: the push, and those of the pressure at rest, 4 m long; not more."""
    case = case_of(tmp_path, load=[PUSH, PRESS])
    run(case, tmp_path / "nodal", comm=MPI.COMM_SELF)
    assert check_dataset(tmp_path / "nodal") == []
    alone = make_body(case_of(tmp_path, load=PUSH), MPI.COMM_SELF)
    shard = read_shard(tmp_path / "nodal" / "shard-00000.h5", "nodal")
    assert shard["samples/pressure"].shape == (3, 1)
    for row, number in enumerate(shard["samples/number"]):
        nodes = shard["samples/loaded_nodes"][row]
        force = scatter_forces(nodes, shard["samples/force"][row], 64)
        push, pressure = alone.loads[number], shard["samples/pressure"][row, 0]
        assert 1.0 <= pressure <= 5.0
        rest = force - scatter_forces(push.nodes, push.forces, 64)
        held = pressure * 4 / 15 / 2  # that of the corner at the support
        assert rest.sum(axis=0) == pytest.approx([0, held - 4 * pressure], abs=1e-10)
    pressures = [float(each.pressures[0]) for each in map(alone_with(case), range(200))]
    assert np.ptp(pressures) > 3.5


def alone_with(case: Case) -> Any:
    return make_body(case, MPI.COMM_SELF).loads.__getitem__


@pytest.mark.parametrize(
    ("load", "said"),
    [
        ([GRIP, GRIP], "prescribe the displacement of one node"),
        ([PUSH, {"family": "wind"}], "load family 'wind'"),
        ([PUSH, PUSH | {"range": [1, -1]}], "key 'load.1.range'"),
        ([PUSH, 3], "expected a mapping"),
        ([], "load"),
        (GRIP | {"region": {"x": 0}}, "expected free nodes only"),
        (GRIP | {"components": ["z"]}, "the body is in the plane"),
        (PRESS | {"region": {"x": 4, "y": 1}}, "belongs to no facet"),
        (PRESS | {"region": {"x": 0}}, "expected free nodes only"),
        ({"family": "body_force", "region": {"y": 1}, "range": [0, 1]}, "belongs to no cell"),
    ],
)
def test_wrong_loads(tmp_path: Path, load: Any, said: str) -> None:
    with pytest.raises(InputError) as error:
        make_body(case_of(tmp_path, load=load), MPI.COMM_SELF)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def joined(corner: np.ndarray, origins: list[tuple[float, ...]]) -> RawMesh:
    """Unit cells at some places, equal corners in common."""
    every = np.concatenate([corner + origin for origin in origins])
    x, number = np.unique(every, axis=0, return_inverse=True)
    kind = "quad" if corner.shape[1] == 2 else "hexahedron"
    return RawMesh(x, number.reshape(len(origins), -1), kind)


def problem(mesh: RawMesh, held: np.ndarray) -> str | None:
    return motion_problem(mesh, np.repeat(held[:, None], mesh.coordinates.shape[1], axis=1))


def test_a_hinge_in_the_plane() -> None:
    """Two squares at one node: the second turns about it, unless it is held at a second node."""
    mesh = joined(QUAD, [(0, 0), (1, 1)])
    x = mesh.coordinates
    found = str(problem(mesh, x[:, 0] == 0))
    assert "the part at 1,2 can still move or turn, it shares 1 nodes but no facet" in found
    assert "the first at 1,1; expected it to be held or joined by facets" in found
    assert problem(mesh, (x[:, 0] == 0) | ((x[:, 0] == 2) & (x[:, 1] == 2))) is None


def test_three_hinges_are_a_triangle_and_four_a_mechanism() -> None:
    """Squares about a hole, joined at corners: three hinges in a ring are stiff, four are not.

    A ring of n bodies with n hinges in the plane has 3 n − 2 n − 3 = n − 3 motions of its own.
    """
    ring = joined(QUAD, [(0, 0), (1, 1), (2, 0), (1, -1)])
    assert "can still move or turn" in str(problem(ring, ring.coordinates[:, 0] == 0))
    two = joined(QUAD, [(0, 0), (1, 0), (2, 1), (1, 2), (0, 2), (-1, 1)])
    assert "can still move" in str(problem(two, two.coordinates[:, 1] == 0))
    legs = [[0, 0], [4, 0], [2, 3], [2, 0.2], [3, 1.6], [1, 1.6]]
    triangle = RawMesh(
        np.array(legs, float), np.array([[0, 1, 3], [1, 2, 4], [2, 0, 5]]), "triangle"
    )
    one_held = np.isin(np.arange(6), [0, 1])
    assert problem(triangle, one_held) is None
    assert "can still move" in str(problem(triangle, np.arange(6) == 0))


@pytest.mark.parametrize(
    ("origin", "shared"), [((1, 1, 0), 2), ((1, 1, 1), 1)], ids=["edge", "node"]
)
def test_a_hinge_in_space(origin: tuple[float, ...], shared: int) -> None:
    """Cubes with an edge in common turn about it, those with a node in every direction."""
    mesh = joined(CUBE, [(0, 0, 0), origin])
    x = mesh.coordinates
    assert f"shares {shared} nodes but no facet" in str(problem(mesh, x[:, 0] == 0))
    assert problem(mesh, (x[:, 0] == 0) | (x[:, 0] == 2)) is None
    beside = joined(CUBE, [(0, 0, 0), (1, 0, 0)])
    assert problem(beside, beside.coordinates[:, 0] == 0) is None


def test_three_nodes_in_common_hold_a_part() -> None:
    """Tetrahedra of two parts with three nodes in common but no facet cannot move."""
    x = np.array(
        [
            [0, 0, 0],
            [2, 0, 0],
            [0, 2, 0],
            [0, 0, -2],
            [2, 0, -2],
            [0, 2, -2],
            [0, 0, 2.0],
            [2, 2, 2],
        ]
    )
    cells = np.array([[0, 3, 4, 5], [0, 1, 4, 5], [0, 1, 2, 5], [0, 1, 6, 7], [0, 2, 6, 7]])
    mesh = RawMesh(x, cells, "tetra")
    assert problem(mesh, np.isin(np.arange(8), [3, 4, 5])) is None
