"""Loads of the command line: at places, on groups, from files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shared_schema.common.bodies.command_loads import CommandLoads, LoadedBody, command_loads
from shared_schema.common.bodies.points_between import PointsBetween
from shared_schema.common.errors import InputError
from shared_schema.common.solution_file import write_solution

X = np.array([[0.0, 0.0], [2.0, 0.0], [5.0, 0.0], [0.0, 1.0], [2.0, 1.0], [5.0, 1.0]])
CELLS = np.array([[0, 1, 4, 3], [1, 2, 5, 4]])


def marked(*nodes: int) -> np.ndarray:
    return np.isin(np.arange(6), nodes)


@pytest.fixture
def body() -> LoadedBody:
    """5 x 1 m of two quadrilaterals; node 0 is clamped and node 3 slides along y."""
    held = np.zeros((6, 2), dtype=bool)
    held[0], held[3, 0] = True, True
    groups = {"top": marked(3, 4, 5), "corners": marked(0, 2, 4), "end": marked(2, 5)}
    return LoadedBody(X, CELLS, "quad", held, groups)


@pytest.fixture
def quadratic(body: LoadedBody) -> LoadedBody:
    """The same body of quadratic elements: 9 points between the nodes."""
    return replace(body, points=PointsBetween.of(CELLS, "quad", len(X)))


def given(body: LoadedBody, *loads: str, nearest: bool = False) -> CommandLoads:
    return command_loads(body, loads, nearest=nearest)


def test_force_on_a_group_is_a_uniform_traction(body: LoadedBody) -> None:
    """Shares 1, 2.5 and 1.5 m of 5 m; what acts along the slide's support is borne by it."""
    forces = given(body, "top:10,-20").forces
    assert forces[[3, 4, 5]] == pytest.approx(np.array([[0, -4], [5, -10], [3, -6]]))
    assert not forces[:3].any()


def test_force_on_a_group_without_facets_is_shared_equally(body: LoadedBody) -> None:
    forces = given(body, "corners:3,6").forces
    assert forces[[0, 2, 4]] == pytest.approx(np.array([[0, 0], [1, 2], [1, 2]]))


def test_force_is_spread_over_a_part_of_the_surface(body: LoadedBody) -> None:
    """About the middle of an edge in equal parts; what a support bears is no load."""
    forces = given(body, "3.5,1,1:10,-20").forces
    assert forces[[4, 5]] == pytest.approx(np.array([[5, -10], [5, -10]]))
    assert not forces[:4].any()
    held = given(body, "0,0.5,0.6:1,1").forces
    assert held[[0, 3]] == pytest.approx(np.array([[0, 0], [0, 0.5]]))


def test_loads_add_up(body: LoadedBody) -> None:
    forces = given(body, "end:0,2", "5,1:1,0", "5,1:1,0").forces
    assert forces[[2, 5]] == pytest.approx(np.array([[0, 1], [2, 1]]))


def test_pressure(body: LoadedBody) -> None:
    """On top it pushes down: 3 Pa on 5 m; deformed, it follows the surface."""
    loads = given(body, "top:3", "end:0,2")
    assert loads.pressures == [3.0]
    assert not loads.forces[[3, 4]].any()
    assert loads.at_rest[[3, 4]] == pytest.approx(np.array([[0, -3], [0, -7.5]]))
    turned = X @ np.array([[0, 1], [-1, 0]])  # by 90°: (x, y) → (−y, x), the top looks to the left
    assert loads.pushed(turned - X).sum(axis=0) == pytest.approx([15, 0])


def test_nearest_node(body: LoadedBody) -> None:
    loads = given(body, "4.1,0.8:0,1", "0.2,0:0,1", nearest=True)
    assert loads.forces[5].tolist() == [0, 1]
    assert loads.forces[3].tolist() == [0, 1]  # node 0 is nearer, but clamped
    assert loads.notes[0] == "--load '4.1,0.8:0,1': acts at the nearest node, 5,1, 0.922 away"
    assert len(given(body, "5,1:0,1", nearest=True).notes) == 0
    with pytest.raises(InputError, match="no node is near, the nearest is at 5,1, farther than"):
        given(body, "4000,1000:0,1", nearest=True)


def test_move(body: LoadedBody) -> None:
    loads = command_loads(body, [], moves=["end:-,0.5"])
    assert loads.moved.tolist() == [[False, bool(node in (2, 5))] for node in range(6)]
    assert loads.displacement[[2, 5]].tolist() == [[0, 0.5], [0, 0.5]]
    at_place = command_loads(body, [], moves=["4.9,1.1:0.2,-"], nearest=True)
    assert np.argwhere(at_place.moved).tolist() == [[5, 0]]
    assert at_place.notes == ["--hold '4.9,1.1:0.2,-': acts at the nearest node, 5,1, 0.141 away"]


def test_forces_of_files(body: LoadedBody, tmp_path: Path) -> None:
    force = np.zeros((6, 2))
    force[4] = 1.0, -2.0
    np.savez(tmp_path / "solved.npz", coordinates=X, force=force, displacement=X)
    (tmp_path / "loads.csv").write_text("x,y,fx,fy\n# two at one node\n5,1,0,1\n\n5,1,2,0\n")
    files = [tmp_path / "solved.npz", tmp_path / "loads.csv"]
    forces = command_loads(body, ["5,0:0,9"], files).forces
    assert forces[[2, 4, 5]].tolist() == [[0, 9], [1, -2], [2, 1]]


@pytest.mark.parametrize(
    ("load", "said"),
    [
        ("hole:1,2", "no such group, the mesh has corners, end, root, top"),
        ("top:1,2,3", "expected 2 numbers (N), or one (Pa)"),
        ("top:nan", "expected finite numbers"),
        ("top:x", "expected 2 numbers (N), or one (Pa)"),
        ("corners:5", "the group has no facet to press on"),
        ("0,1:1,1", "the node at 0,1 is held in x"),
        ("0,0:1,1", "the node is clamped"),
        ("5,0.5:1,1", "the nearest is at 5,0 (--nearest)"),
        ("5,1:1", "expected X,Y:FX,FY"),
        ("top:1e300,0", "at most 1e+12"),
        ("5,1,0:1,1", "a radius of 0, expected one above 0 m"),
        ("5,1,nan:1,1", "expected finite numbers"),
        ("5,2,0.5:1,1", "no part of the surface lies within 0.5 m of it"),
        ("5,1,0.5:1", "expected X,Y:FX,FY, or X,Y,R:FX,FY"),
        ("root:1,0", "all of it acts on supports"),
        ("root:1", "all of it acts on supports"),
        ("0,0.5,0.6:1,0", "all of it acts on supports"),
    ],
)
def test_wrong_loads(body: LoadedBody, load: str, said: str) -> None:
    body.held[3] |= load == "root:1"  # the left edge does not move at all
    body = replace(body, groups={**body.groups, "root": marked(0, 3)})
    with pytest.raises(InputError) as error:
        given(body, load)
    assert said in str(error.value)
    assert f"--load '{load}'" in str(error.value)


@pytest.mark.parametrize(
    ("move", "said"),
    [
        ("hole:1,2", "the groups of the mesh are corners, end, top"),
        ("end:1", "expected 2 numbers (m), or - for a free component"),
        ("top:1,0", "held or moved already"),
        ("end:-,-", "a displacement of one component at least"),
        ("0,0:1,0", "the node is clamped"),
        ("5,0.5:1,0", "the nearest is at 5,0 (--nearest)"),
        ("5,nan:1,0", "expected finite numbers"),
    ],
)
def test_wrong_moves(body: LoadedBody, move: str, said: str) -> None:
    with pytest.raises(InputError) as error:
        command_loads(body, [], moves=[move])
    assert said in str(error.value)


def test_force_and_displacement_of_one_component(body: LoadedBody) -> None:
    """What acts on a held component, a part of the weight at least, the grip bears."""
    loads = command_loads(body, ["5,1:1,1"], moves=["end:-,0.5"], body_force=(0, -1))
    assert loads.forces[5, 0] == 1
    assert loads.moved[5].tolist() == [False, True]


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.csv", b"5,1,0\n", "line 1: expected X,Y,FX,FY"),
        ("a.csv", b"x,y,fx,fy\n5,1,0,inf\n", "line 2: expected finite numbers"),
        ("a.csv", b"9,9,0,1\n", "no node stands there"),
        ("a.csv", b"\xff\xfe", "cannot be read"),
        ("a.npz", b"PK", "expected a file .npz with 'force' and 'coordinates'"),
        ("a.txt", b"", "expected a file name ending in .npz, .csv"),
    ],
)
def test_wrong_files(
    body: LoadedBody, tmp_path: Path, name: str, content: bytes, said: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as error:
        command_loads(body, [], [tmp_path / name])
    assert said in str(error.value)
    assert f"--forces '{tmp_path / name}'" in str(error.value)


def test_solution_of_another_mesh(body: LoadedBody, tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", coordinates=X + 1, force=X)
    with pytest.raises(InputError, match="on another mesh"):
        command_loads(body, [], [tmp_path / "a.npz"])


def test_no_load_at_all(body: LoadedBody) -> None:
    with pytest.raises(InputError, match="expected --load, --forces or --body-force"):
        command_loads(body, [])


def test_body_force(body: LoadedBody) -> None:
    """The cells are 2 and 3 m long: a quarter of each cell's volume belongs to each corner of it.

    What acts on node 0 and along the slide's support of node 3 is borne by them.
    """
    forces = command_loads(body, ["5,1:0,1"], body_force="4,-8").forces
    at_nodes = np.array([[0, 0], [5, -10], [3, -6], [0, -4], [5, -10], [3, -5]])
    assert forces == pytest.approx(at_nodes)
    alone = command_loads(body, [], body_force=(4, -8)).forces
    assert alone[5] == pytest.approx([3, -6])


@pytest.mark.parametrize("text", ["1", "1,2,3", "x,1", "nan,0", "1e300,0", ""])
def test_wrong_body_forces(body: LoadedBody, text: str) -> None:
    with pytest.raises(InputError, match=f"--body-force '{text}': expected "):
        command_loads(body, [], body_force=text)


@pytest.mark.parametrize("left", [1, 4, 7])
def test_force_on_a_volume_does_not_depend_on_its_cells(left: int) -> None:
    """10 N on a square of 2 × 2 m: of each half 5 N, and their moment about x = 0 is 10 N · 1 m.

    The left half is divided into more cells than the right one, so that it has more nodes.
    """
    along = np.concatenate([np.linspace(0, 1, left + 1), [1.5, 2.0, 3.0]])
    x = np.array([[a, b] for b in (0.0, 1.0, 2.0) for a in along])
    row = len(along)
    first = np.array([i + j * row for j in range(2) for i in range(row - 1)])
    cells = np.stack([first, first + 1, first + row + 1, first + row], axis=1)
    volume = x[:, 0] < 2.1
    body = LoadedBody(x, cells, "quad", np.zeros(x.shape, dtype=bool), {"block": volume})
    forces = given(body, "block:0,10").forces[:, 1]
    assert forces.sum() == pytest.approx(10.0)
    assert forces @ x[:, 0] == pytest.approx(10.0 * 1.0)
    assert not forces[~volume].any()


def test_groups_of_mixed_nodes_are_refused(body: LoadedBody) -> None:
    """A facet and a node beside it have no share that would not depend on the mesh."""
    body.groups["mixed"] = marked(2, 3, 5)  # type: ignore[index]
    with pytest.raises(InputError, match="group 'mixed' has nodes beside its cells and facets"):
        given(body, "mixed:0,1")


def between(body: LoadedBody, loads: CommandLoads) -> dict[tuple[float, float], list[float]]:
    """Forces on points between the nodes other than zero, by their places."""
    forces = loads.at_rest_between
    assert forces is not None
    places = body.positions[len(X) :]
    return {(x, y): f.tolist() for (x, y), f in zip(places, forces, strict=True) if f.any()}


def test_quadratic_edge_under_a_traction(quadratic: LoadedBody, body: LoadedBody) -> None:
    """4/6 of the force on an edge acts in its middle; its share at the nodes stays 1/2 each."""
    loads = given(quadratic, "end:0,6")
    assert loads.forces == pytest.approx(given(body, "end:0,6").forces)
    assert between(quadratic, loads) == {(5, 0.5): pytest.approx([0, 4])}
    loads.scale(0.5)
    assert between(quadratic, loads) == {(5, 0.5): pytest.approx([0, 2])}
    assert loads.forces.sum(axis=0) == pytest.approx([0, 3])


def test_quadratic_edge_under_a_pressure(quadratic: LoadedBody) -> None:
    """It acts on all points: on a bulge of h of an edge of 1 m it still adds up to p · 1 m."""
    loads = given(quadratic, "end:6")
    assert between(quadratic, loads) == {(5, 0.5): pytest.approx([-4, 0])}
    assert loads.at_rest[[2, 5]] == pytest.approx(np.array([[-3, 0], [-3, 0]]))
    bulge = 0.3 * np.isclose(quadratic.positions, [5, 0.5]).all(axis=1)
    pushed = loads.pushed(np.outer(bulge, [1, 0]))
    assert pushed.sum(axis=0) == pytest.approx([-6, 0], abs=1e-14)
    assert pushed[2, 1] == pytest.approx(-pushed[5, 1])
    assert pushed[2, 1] == pytest.approx(6 * 0.3 * 2 / 3)  # p ∫ N x' dy with x = 4 h y (1 - y)


def test_body_force_on_quadratic_cells(quadratic: LoadedBody, body: LoadedBody) -> None:
    """Simpson's rule: 16/36 in the centre, 4/36 in the middle of an edge, of 2 and 3 m².

    Held points have none: the middle of the left edge lies between a clamped node and one that
    slides along y, so that it is held in x.
    """
    loads = command_loads(quadratic, (), body_force=(36.0, 36.0))
    assert loads.forces == pytest.approx(command_loads(body, (), body_force=(36.0, 36.0)).forces)
    found = between(quadratic, loads)
    assert len(found) == 9
    assert found[1, 0.5] == pytest.approx([32, 32])
    assert found[3.5, 1] == pytest.approx([12, 12])
    assert found[2, 0.5] == pytest.approx([20, 20])
    assert found[0, 0.5] == pytest.approx([0, 8])


def test_forces_between_of_a_file(quadratic: LoadedBody, body: LoadedBody, tmp_path: Path) -> None:
    """They act where the elements have points there; linear ones take the forces at the nodes."""
    loads, file = given(quadratic, "end:0,6"), tmp_path / "solution.npz"
    fields = {"force": loads.at_rest, "displacement": 0 * X}
    write_solution(file, X, CELLS, "quad", fields, force_between=loads.at_rest_between)
    again = command_loads(quadratic, (), [file])
    assert between(quadratic, again) == between(quadratic, loads)
    assert command_loads(body, (), [file]).forces == pytest.approx(loads.forces)
    write_solution(file, X, CELLS, "quad", fields, force_between=np.zeros((3, 2)))
    with pytest.raises(InputError, match=r"force_between of shape \(3, 2\), expected \(9, 2\)"):
        command_loads(quadratic, (), [file])


def test_a_force_at_a_node_stays_one_at_a_corner(quadratic: LoadedBody) -> None:
    loads = given(quadratic, "5,1:1,0", "corners:3,6")
    assert between(quadratic, loads) == {}


def test_forces_that_are_not_finite(body: LoadedBody) -> None:
    with pytest.raises(InputError, match="nodal forces hold a NaN or an infinity"):
        command_loads(body, np.full(X.shape, np.nan))
