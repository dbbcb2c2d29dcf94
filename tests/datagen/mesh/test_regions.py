"""Regions against nodes counted by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.loads.regions import Region

GRID = np.stack(np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0], indexing="ij"), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize(
    ("region", "count"),
    [
        ({}, 6),
        ({"x": 0}, 2),
        ({"x": "> 0"}, 4),
        ({"x": ">= 0"}, 6),
        ({"x": "< 2"}, 4),
        ({"x": "<= 1", "y": 1}, 2),
        ({"y": 1, "x": "> 0"}, 2),
        ({"x": 0.5}, 0),
        ({"x": "> 0 and < 2"}, 2),
        ({"sphere": [0, 0, 1]}, 3),
        ({"sphere": [1, 0.5, 0.6], "y": 1}, 1),
    ],
)
def test_selection(region: dict[str, Any], count: int) -> None:
    assert Region(**region).select(GRID).sum() == count


@pytest.mark.parametrize(
    ("region", "count"),
    [
        ({"plane": [1, 0, 0, 2, 0, 0]}, 2 * 4 * 3),  # x = 0 and 1 of 4 × 4 × 3 nodes
        ({"plane": [0, 0, 0, 1, 1, 0]}, 3),
        ({"patch": [1, 1, 9, 9]}, 16),  # one side
        ({"patch": [1, 1, 9, 9, 90]}, 48 - 4),  # all of the surface
        ({"patch": [1, 1, 2, 1]}, 5),  # a cross
        ({"patch": [1, 1, 2, 1.5]}, 9),
        ({"patch": [0, 1, 2.2, 1]}, 4),  # up to the edge
        ({"patch": [1, 1, 2, 0.5]}, 1),
    ],
)
def test_planes_and_patches(region: dict[str, Any], count: int) -> None:
    axes = np.meshgrid(*[np.arange(4.0)] * 2, np.arange(3.0), indexing="ij")
    x = np.stack(axes, axis=-1).reshape(-1, 3)
    n = np.arange(len(x)).reshape(4, 4, 3)
    low = [n[:-1, :-1], n[1:, :-1], n[1:, 1:], n[:-1, 1:]]
    corners = [each[:, :, :-1] for each in low] + [each[:, :, 1:] for each in low]
    cells = np.stack(corners, axis=-1).reshape(-1, 8)
    facets = boundary_facets(cells, "hexahedron")
    assert Region(**region).select(x, facets=facets).sum() == count


def test_a_patch_of_a_plane_body() -> None:
    """The side y = 0 of 2 × 1 m; beyond the corner, edges turn by 90°."""
    facets = boundary_facets(np.array([[0, 2, 3, 1], [2, 4, 5, 3]]), "quad")
    assert Region(patch=(1, -3, 5)).select(GRID, facets=facets).tolist() == [True, False] * 3
    assert Region(patch=(1, -3, 1.1, 90)).select(GRID, facets=facets).sum() == 3
    assert Region(patch=(1, -3, 1.5, 90)).select(GRID, facets=facets).sum() == 6
    with pytest.raises(ValueError, match="patch: 5 numbers, expected those of a position in 2"):
        Region(patch=(0, 0, 0, 1, 10)).select(GRID, facets=facets)
    with pytest.raises(ValueError, match="plane: 6 numbers, expected 4"):
        Region(plane=(0, 0, 0, 1, 1, 1)).select(GRID)


def test_rounding_does_not_move_a_node_over_the_border() -> None:
    """Comparisons have a tolerance of 1e-6 of the size of the mesh."""
    noisy = GRID + 1e-9
    assert Region(x="> 0").select(noisy).sum() == 4
    assert Region(x="<= 2").select(noisy).sum() == 6


@pytest.mark.parametrize("text", ["0 <", "> one", "near 0", "== 1", ">"])
def test_invalid_conditions(text: str) -> None:
    with pytest.raises(ValidationError, match="a comparison such as '> 0'"):
        Region(x=text)


@pytest.mark.parametrize("sphere", [[0, 1], [0, 0, -1], [0, 0, float("nan")], [0, 0, 0, 0, 1]])
def test_invalid_spheres(sphere: list[float]) -> None:
    with pytest.raises(ValidationError, match="sphere"):
        Region(sphere=tuple(sphere))


def test_a_sphere_of_other_dimension() -> None:
    with pytest.raises(ValueError, match="sphere: 4 numbers, expected those of a centre in 2"):
        Region(sphere=(0, 0, 0, 1)).select(GRID)


def test_unknown_axis() -> None:
    with pytest.raises(ValidationError, match="w"):
        Region.model_validate({"w": 1})


def test_group_and_coordinates_together() -> None:
    """The region has the nodes of the group that also meet the other conditions."""
    groups = {"side": np.array([0, 1, 4])}
    assert np.flatnonzero(Region(group="side").select(GRID, groups)).tolist() == [0, 1, 4]
    assert np.flatnonzero(Region(group="side", x=0).select(GRID, groups)).tolist() == [0, 1]
    with pytest.raises(ValueError, match="group 'top': the mesh has no such group, but side"):
        Region(group="top").select(GRID, groups)


def test_a_group_is_written_only_where_there_is_one() -> None:
    """Datasets of cases without groups keep their digest."""
    assert Region(x=0).model_dump(mode="json") == {"x": 0.0, "y": None, "z": None}
    assert Region(group="a").model_dump(mode="json")["group"] == "a"
    assert Region(boundary=True).model_dump()["boundary"] is True


def test_boundary_of_a_square() -> None:
    """Sixteen nodes on the surface of 4 x 4 squares; nine inside."""
    x = np.stack(np.meshgrid(range(5), range(5), indexing="ij"), axis=-1).reshape(-1, 2) / 1.0
    low = np.array([5 * i + j for i in range(4) for j in range(4)])
    cells = np.stack([low, low + 5, low + 6, low + 1], axis=1)
    facets = boundary_facets(cells, "quad")
    on_surface = Region(boundary=True).select(x, facets=facets)
    assert on_surface.sum() == 16
    assert not on_surface[np.all((x > 0) & (x < 4), axis=1)].any()
    assert Region(boundary=True, x="> 0").select(x, facets=facets).sum() == 11
    with pytest.raises(ValueError, match="the facets of the surface are not known"):
        Region(boundary=True).select(x)


def test_node_numbers(tmp_path: Path) -> None:
    """Numbers of the mesh's file, from 0 or 1; its third point belongs to no cell."""
    places = np.array([0, 1, 3, 4, 5, 6])
    from_zero = Region(nodes=(5, 0, 3), nodes_from=0)
    assert np.flatnonzero(from_zero.select(GRID, places=places)).tolist() == [0, 2, 4]
    from_one = Region(nodes=(6, 1, 4), nodes_from=1, x="> 0")
    assert np.flatnonzero(from_one.select(GRID, places=places)).tolist() == [2, 4]
    file = tmp_path / "held.txt"
    file.write_text("# from 1\n6, 1\n4  # the last\n")
    read = Region.model_validate({"nodes": "held.txt", "nodes_from": 1}, context=tmp_path)
    assert read.nodes == (6, 1, 4)


@pytest.mark.parametrize(
    ("nodes", "first", "said"),
    [
        ((8,), 1, "node 8: expected 1 to 7"),
        ((0,), 1, "node 0: expected 1 to 7"),
        ((3,), 1, "node 3: belongs to no cell"),
        ((2,), 0, "node 2: belongs to no cell"),
    ],
)
def test_numbers_of_no_node(nodes: tuple[int, ...], first: Any, said: str) -> None:
    region = Region(nodes=nodes, nodes_from=first)
    with pytest.raises(ValueError, match=said):
        region.select(GRID, places=np.array([0, 1, 3, 4, 5, 6]))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"nodes": (1, 2, 1), "nodes_from": 0}, "node 1 stands there twice"),
        ({"nodes": (), "nodes_from": 0}, "expected one node at least"),
        ({"nodes": (1, 2)}, "expected 'nodes', and 'nodes_from' = 0 or 1"),
        ({"nodes_from": 1}, "expected 'nodes', and 'nodes_from' = 0 or 1"),
        ({"nodes": (-1,), "nodes_from": 0}, "greater than or equal to 0"),
        ({"nodes": (1.5,), "nodes_from": 0}, "integer"),
        ({"nodes": (1,), "nodes_from": 2}, "0 or 1"),
        ({"nodes": "missing.txt", "nodes_from": 0}, "no such file"),
        ({"nodes": "words.txt", "nodes_from": 0}, "'one' in .*words.txt, expected whole numbers"),
        ({"nodes": "empty.txt", "nodes_from": 0}, "expected one node at least"),
        ({"nodes": "../words.bin", "nodes_from": 0}, "no such file"),
    ],
)
def test_wrong_node_lists(content: dict[str, Any], said: str, tmp_path: Path) -> None:
    (tmp_path / "words.txt").write_text("1\none\n")
    (tmp_path / "empty.txt").write_text("# nothing\n")
    with pytest.raises(ValidationError, match=said):
        Region.model_validate(content, context=tmp_path)


def test_no_file_is_read_for_a_dataset() -> None:
    """A dataset holds the numbers themselves."""
    with pytest.raises(ValidationError, match="nodes"):
        Region.model_validate({"nodes": "held.txt", "nodes_from": 1})
