"""Tools of any closed surface: distances, normals and curvatures, and what is refused."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from shared_schema.common.errors import InputError
from shared_schema.common.units import SI
from shared_schema.tools import (
    Capsule,
    Contact,
    Displaced,
    Mesh,
    Plane,
    Sphere,
    contact_line,
    parse_tool,
)
from tests.closed_surfaces import CUBE, FACES, ball, surface_file


@pytest.fixture
def cube(tmp_path: Path) -> Mesh:
    return Mesh(surface_file(tmp_path / "cube.stl"), rounding=0.0)


def test_distance_to_a_cube(cube: Mesh) -> None:
    """Outside |max(q, 0)| and inside max(q) with q = |x − c| − 1/2, to the last digits."""
    x = np.random.default_rng(0).uniform(-0.8, 1.8, (3000, 3))
    q = np.abs(x - 0.5) - 0.5
    outside = np.linalg.norm(np.maximum(q, 0), axis=1)
    np.testing.assert_allclose(cube.gap(x), outside + np.minimum(q.max(axis=1), 0), atol=1e-12)
    assert (outside == 0).sum() > 100


def test_derivatives(cube: Mesh) -> None:
    """Normals and curvatures are differences of distances: at faces, edges and corners."""
    x = np.random.default_rng(1).uniform(-0.8, 1.8, (500, 3))
    h, n = 1e-6, cube.normal(x)
    for axis, step in enumerate(h * np.eye(3)):
        slope = (cube.gap(x + step) - cube.gap(x - step)) / (2 * h)
        bend = (cube.normal(x + step) - cube.normal(x - step)) / (2 * h)
        smooth = np.abs(bend).max(axis=1) < 100  # not where the nearest face changes, inside
        assert smooth.mean() > 0.98
        np.testing.assert_allclose(n[smooth, axis], slope[smooth], atol=1e-5)
        np.testing.assert_allclose(cube.curvature(x)[smooth, axis], bend[smooth], atol=1e-4)


def test_fine_ball_is_a_sphere_at_its_pose(tmp_path: Path) -> None:
    path = surface_file(tmp_path / "ball.stl", *ball(4000))
    tool = Mesh(path, (1.0, 2.0, 3.0), (0.3, -0.2, 0.9), 0.5, rounding=0.1)
    exact = Sphere((1.0, 2.0, 3.0), 0.6)
    x = np.array(exact.begin) + np.random.default_rng(2).normal(size=(200, 3))
    np.testing.assert_allclose(tool.gap(x), exact.gap(x), atol=1e-3)
    np.testing.assert_allclose(tool.normal(x), exact.normal(x), atol=0.06)
    moved = tool.moved((0.0, 1.0, 0.0), (0.0, 0.0, 0.0))
    np.testing.assert_allclose(moved.gap(x - [1, 1, 3]), tool.gap(x), atol=2e-3)


def test_pose_turns_the_axes(cube: Mesh) -> None:
    turn = (0.0, 0.0, np.pi / 6)
    x = np.random.default_rng(3).normal(size=(50, 3))
    moved = cube.moved((0.4, 0.0, 0.0), turn)
    matrix = Rotation.from_rotvec(turn).as_matrix()
    back = (x - [0.4, 0.0, 0.0]) @ matrix
    np.testing.assert_allclose(moved.gap(x), cube.gap(back), atol=1e-12)
    np.testing.assert_allclose(moved.normal(x), cube.normal(back) @ matrix.T, atol=1e-12)
    expected = matrix @ cube.curvature(back) @ matrix.T
    np.testing.assert_allclose(moved.curvature(x), expected, atol=1e-9)


def test_points_of_tools(cube: Mesh) -> None:
    """One that is inside of the tool, wherever it is; a plane has none."""
    turned = cube.moved((0.4, 0.0, 0.0), (0.1, -0.3, 0.5))
    rod = Capsule((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.1)
    for tool in (cube, turned, rod, Displaced(turned, (0.0, 2.0, 0.0))):
        assert tool.inside is not None
        assert tool.gap(tool.inside[None])[0] < -0.09
    assert Displaced(Plane((0.0, 0.0), (0.0, 1.0)), (1.0, 0.0)).inside is None


def test_surface_from_inside_is_turned(tmp_path: Path) -> None:
    tool = Mesh(surface_file(tmp_path / "inside.stl", CUBE, FACES[:, ::-1]), rounding=0.0)
    np.testing.assert_allclose(tool.gap(np.array([[0.5, 0.5, 0.4]])), -0.4)


def test_what_is_refused(tmp_path: Path, cube: Mesh) -> None:
    path = str(surface_file(tmp_path / "cube.stl"))
    is_open = surface_file(tmp_path / "open.stl", CUBE, FACES[:-1])
    with pytest.raises(InputError, match=r"open.stl: expected a closed surface, found 3 edges"):
        Mesh(is_open)
    mixed = FACES.copy()
    mixed[0] = mixed[0, ::-1]
    with pytest.raises(InputError, match="all seen from outside"):
        Mesh(surface_file(tmp_path / "mixed.stl", CUBE, mixed))
    (tmp_path / "text.stl").write_text("no solid")
    for name in ("text.stl", "none.stl"):
        with pytest.raises(InputError, match=name):
            Mesh(tmp_path / name)
    for wrong in ({"scale": -1.0}, {"scale": np.nan}, {"rounding": -1.0}, {"place": (np.nan,) * 3}):
        with pytest.raises(InputError, match="mesh: "):
            Mesh(path, **wrong)
    for text in (f"mesh:{path}:0,0", f"mesh:{path}:0,0,0:0,0,0:1,2", "mesh:", f"mesh:{path}:x,0,0"):
        with pytest.raises(InputError, match="--tool mesh"):
            parse_tool(text, 3)
    with pytest.raises(InputError, match="expected points of 2 components"):
        parse_tool(f"mesh:{path}", 2)
    tool = parse_tool(f"mesh:{path}:0,0,1:0,0,0:0.5", 3)
    np.testing.assert_allclose(tool.gap(np.array([[0.25, 0.25, 2.0]])), 0.5 - 0.005)
    assert tool.size == pytest.approx(1.505)


def test_meshes_that_are_named_are_no_files(tmp_path: Path, cube: Mesh) -> None:
    """Names mean the meshes that there are; a file is as unknown as none, and is not opened."""
    x = np.array([[0.5, 0.5, 2.0]])
    for pose, gap in (("", 1.0), (":0,0,0.25", 0.75), (":0,0,0:0,1.5707963267948966,0", 2.0)):
        tool = parse_tool(f"mesh:cube{pose}", 3, {"cube": cube})
        np.testing.assert_allclose(tool.gap(x), gap, atol=1e-12)
    assert parse_tool("sphere:0,0,0:1", 3, {}).size == 1
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)  # to open it would take forever
    for name in (str(fifo), str(tmp_path / "cube.stl"), str(tmp_path / "none"), "", "cube:0,0,0:0"):
        with pytest.raises(InputError) as caught:
            parse_tool(f"mesh:{name}", 3, {"cube": cube})
        expected = "expected mesh:NAME[:X,Y,Z[:RX,RY,RZ]], the meshes are cube"
        assert str(caught.value) == f"--tool mesh:{name}: {expected}"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", r"empty\.stl: "),
        (b"solid nothing\nendsolid nothing\n", r"empty\.stl: expected triangles, found none"),
        (bytes(84), r"empty\.stl: expected triangles, found none"),
    ],
)
def test_files_without_triangles(content: bytes, said: str, tmp_path: Path) -> None:
    """No byte, a text without facets, and a binary file whose count is zero."""
    path = tmp_path / "empty.stl"
    path.write_bytes(content)
    with pytest.raises(InputError, match=said):
        Mesh(path)
    with pytest.raises(InputError, match=r"--tool mesh:.*empty"):
        parse_tool(f"mesh:{path}", 3)


@pytest.mark.parametrize(("d", "fewest"), [(2, 3), (3, 8)])
def test_the_line_of_a_tool(d: int, fewest: int) -> None:
    """It says that a force on few nodes depends on the mesh; none of them is no force."""
    for touched in (0, 1, fewest - 1, fewest):
        line = contact_line(Contact(np.eye(12, d)[:1].repeat(touched, axis=0), 0.0), SI)
        assert f"N on {touched} nodes" in line
        assert ("at most a third of the tool's radius" in line) == (0 < touched < fewest)
