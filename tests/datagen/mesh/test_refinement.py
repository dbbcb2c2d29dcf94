"""Uniform refinement of meshes: volumes, conformity, groups and lists of nodes."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from datagen.cases.case import read_case
from datagen.cases.placed_body import placed
from datagen.mesh.geometries import Box
from datagen.mesh.mesh_file import MeshFile
from datagen.mesh.raw_mesh import DIMENSION, raw_mesh
from datagen.mesh.refinement import refined
from shared_schema.common.bodies.cells import boundary_facets, conformity_problem
from shared_schema.common.bodies.distributed_loads import cell_shares
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.loads.regions import members_of
from tests.datagen.mesh.test_mesh_file import SCRIPTS
from tests.datagen.refusal import refusal


@pytest.fixture(params=SCRIPTS, scope="module")
def mesh(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> RawMesh:
    folder = tmp_path_factory.mktemp("mesh")
    (folder / "own.geo").write_text(SCRIPTS[request.param])
    return MeshFile(kind="file", path="own.geo").found_from(folder).raw_mesh()


def volumes(mesh: RawMesh) -> np.ndarray:
    return cell_shares(mesh.coordinates[mesh.cells]).sum(axis=1)


def test_cells_fill_those_of_before(mesh: RawMesh) -> None:
    """Each part is a cell like those that a user may give, and eight (four) fill their cell."""
    fine = refined(mesh)
    parts = 2 ** DIMENSION[mesh.cell_type]
    np.testing.assert_allclose(volumes(fine).reshape(-1, parts).sum(axis=1), volumes(mesh))
    assert conformity_problem(fine.coordinates, fine.cells, fine.cell_type) is None
    again = raw_mesh(fine.coordinates, [(fine.cell_type, fine.cells)], {})  # refuses flat cells
    np.testing.assert_array_equal(again.cells, fine.cells)
    np.testing.assert_array_equal(fine.coordinates[: len(mesh.coordinates)], mesh.coordinates)


def test_facets_lie_on_the_surface_of_before(mesh: RawMesh) -> None:
    """Twice: four and sixteen times as many facets in space, with the same area."""
    fine = refined(refined(mesh))
    before, after = (boundary_facets(m.cells, m.cell_type) for m in (mesh, fine))
    d = DIMENSION[mesh.cell_type]
    assert len(after) == len(before) * 4 ** (d - 1)
    assert fine.origins is not None
    coarse = {tuple(sorted(set(row))) for row in before.tolist()}
    within = [set(fine.origins[facet].ravel().tolist()) for facet in after]
    assert all(any(found <= set(facet) for facet in coarse) for found in within[::7])


def test_two_levels_come_from_the_first_mesh(mesh: RawMesh) -> None:
    """A node lies within the box around the nodes that it comes from."""
    fine = refined(refined(mesh))
    assert fine.origins is not None
    corners = mesh.coordinates[fine.origins]
    assert (fine.coordinates >= corners.min(axis=1) - 1e-12).all()
    assert (fine.coordinates <= corners.max(axis=1) + 1e-12).all()


@pytest.mark.parametrize("d", [2, 3])
def test_a_box_becomes_the_box_of_twice_as_many_elements(d: int, tmp_path: Path) -> None:
    lower, upper, count = (0.0,) * d, (2.0, 1.0, 1.5)[:d], (3, 2, 2)[:d]
    coarse = Box(lower=lower, upper=upper, elements=count).raw_mesh()
    fine = Box(lower=lower, upper=upper, elements=tuple(2 * n for n in count)).raw_mesh()
    found = refined(coarse)
    keys = [np.round(m.coordinates[m.cells].mean(axis=1), 9) for m in (found, fine)]
    order, expected = (np.lexsort(k.T) for k in keys)
    np.testing.assert_allclose(keys[0][order], keys[1][expected], atol=1e-9)
    assert len(found.coordinates) == len(fine.coordinates)


def test_groups_hold_the_middles_of_their_edges_and_parts_of_their_cells() -> None:
    """Two triangles: a side is a group with its middle; the diagonal is inside and no side."""
    points = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    cells = np.array([[0, 1, 2], [0, 2, 3]])
    members = {"low": np.array([0, 1]), "ends": np.array([0, 2]), "all": np.arange(4)}
    groups = {(0, name): nodes for name, nodes in members.items()}
    mesh = raw_mesh(points, [("triangle", cells)], groups, {"right": [np.array([0])]})
    fine = refined(mesh)
    found = {name: sorted(map(tuple, fine.coordinates[m])) for name, m in fine.groups.items()}
    assert found["low"] == [(0, 0), (0.5, 0), (1, 0)]
    assert found["ends"] == [(0, 0), (1, 1)]
    assert len(found["all"]) == 9 - 1
    assert fine.cell_groups["right"].tolist() == [0, 1, 2, 3]
    assert volumes(fine)[fine.cell_groups["right"]].sum() == pytest.approx(0.5)


def test_lists_of_nodes_refer_to_the_file(tmp_path: Path) -> None:
    """Nodes of the file keep their numbers; those of a side come with all that lie on it."""
    x = np.array([[i, j] for j in range(3) for i in range(5)], float)
    cells = [
        [5 * j + i, 5 * j + i + 1, 5 * j + i + 6, 5 * j + i + 5] for j in (0, 1) for i in range(4)
    ]
    meshio.write(tmp_path / "plate.vtk", meshio.Mesh(np.c_[x, 0 * x[:, 0]], [("quad", cells)]))
    (tmp_path / "plate.yaml").write_text(
        "name: plate\n"
        "mesh: {kind: file, path: plate.vtk, refine: 2}\n"
        "material: {young_modulus: 500, poisson_ratio: 0.4}\n"
        "supports: [{nodes: [1, 6, 11], nodes_from: 1}]\n"
        'load: {family: random_node, region: {x: "> 3.9"}, range: [-1, 1]}\n'
        "dataset: {samples: 2, seed: 1}\n"
    )
    case = read_case(str(tmp_path / "plate.yaml"))
    body = placed(case, case.mesh.raw_mesh())
    clamped = body.mesh.coordinates[body.clamped]
    np.testing.assert_allclose(sorted(clamped[:, 1]), np.linspace(0, 2, 9))
    assert not clamped[:, 0].any()
    assert len(body.mesh.cells) == 8 * 16


def test_inner_nodes_do_not_join_the_surface() -> None:
    """An edge through the body whose ends are on the surface and belong: its middle does not."""
    origins = np.array([[0, 0], [1, 1], [0, 1]])
    members = np.ones(2, dtype=bool)
    inside, outside = np.array([True, True, False]), np.array([True, True, True])
    assert members_of(members, origins, inside).tolist() == [True, True, False]
    assert members_of(members, origins, outside).tolist() == [True, True, True]


@pytest.mark.parametrize("value", ["-1", "7", "1.5"])
def test_wrong_numbers_of_refinements(
    value: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["body", "breast3d", "--set", f"mesh.refine={value}", "--out", str(tmp_path / "b")]
    assert "mesh.refine" in refusal(words, capsys)
    assert not (tmp_path / "b").exists()
