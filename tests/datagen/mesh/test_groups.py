"""Groups whose nodes are also all those of other facets or cells: loads act on the group alone.

A strip of 3 × 0.2 m, one cell thick: the nodes of its lower and upper side are those of its ends
and cells too. A frame of eight unit squares about a ninth has all nodes of that one.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import yaml

import datagen
from datagen.cases.case import read_case
from datagen.cases.placed_body import PlacedBody
from shared_schema.checker import check_dataset
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.errors import InputError
from tests.datagen.mesh.files.test_gmsh_file import case_at
from tests.datagen.mesh.test_mesh_file import CASE, mesh_at

STRIP = """SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 3, 0.2};
Transfinite Curve {1, 3} = 7;
Transfinite Curve {2, 4} = 2;
Transfinite Surface {1};
Recombine Surface {1};
Physical Surface("body") = {1};
Physical Curve("skin") = {1, 3};
"""


def strip(folder: Path) -> Path:
    (folder / "strip.geo").write_text(STRIP)
    return folder / "strip.geo"


def frame(folder: Path) -> Path:
    """Nine unit squares of VTU: the array `part` is 2 in the middle one, else 1."""
    x = np.array([(i, j, 0.0) for j in range(4) for i in range(4)])
    cells = np.array([(n, n + 1, n + 5, n + 4) for j in range(3) for n in range(4 * j, 4 * j + 3)])
    part = np.where(np.arange(9) == 4, 2, 1)
    path = folder / "frame.vtu"
    meshio.Mesh(x, [("quad", cells)], cell_data={"part": [part]}).write(path)
    return path


def held(path: Path, **changes: Any) -> PlacedBody:
    """The body, held at x = 0."""
    return case_at(path, supports=[{"x": 0}], **changes)


def solved(path: Path, load: str) -> datagen.Solution:
    held(path)
    return datagen.solve(path.parent / "own.yaml", load)


def test_pressure_on_both_sides_of_a_strip(tmp_path: Path) -> None:
    """Pressures of 1 Pa on both sides are in balance: 1.5 N on each, none along the strip."""
    found = solved(strip(tmp_path), "skin:1")
    above = found.coordinates[:, 1] > 0.1
    free = found.coordinates[:, 0] > 0
    assert found.force[:, 0] == pytest.approx(np.zeros(14), abs=1e-12)
    # a half of the first facet, 0.25 N, acts on the support
    assert found.force[above & free, 1].sum() == pytest.approx(-2.75)
    assert found.force[~above & free, 1].sum() == pytest.approx(2.75)


def test_force_on_both_sides_of_a_strip(tmp_path: Path) -> None:
    """A force of 6 N on 6 m is a traction of 1 Pa: 0.5 N at inner nodes, 0.25 N at the end."""
    found = solved(strip(tmp_path), "skin:0,6")
    inner = (found.coordinates[:, 0] > 0) & (found.coordinates[:, 0] < 3)
    assert found.force[inner, 1] == pytest.approx(np.full(10, 0.5))
    assert found.force[found.coordinates[:, 0] == 3, 1] == pytest.approx([0.25, 0.25])


def test_force_on_a_frame_leaves_its_middle(tmp_path: Path) -> None:
    """8 N on eight squares: a quarter of each to its corners, three of which meet at (1, 1)."""
    found = solved(frame(tmp_path), "1:0,8")
    at = (found.coordinates == (1, 1)).all(axis=1)
    assert found.force[at, 1] == pytest.approx([0.75])


@pytest.mark.parametrize("family", ["pressure", "traction"])
def test_families_on_a_strip(family: str, tmp_path: Path) -> None:
    load = {"family": family, "region": {"group": "skin"}, "range": [1, 2]}
    facets = held(strip(tmp_path), load=load).loads.parts[0].loadable.facets
    assert len(facets) == 12  # without the two ends


def test_body_force_on_a_frame(tmp_path: Path) -> None:
    load = {"family": "body_force", "region": {"group": "1"}, "range": [1, 2]}
    body = held(frame(tmp_path), load=load)
    load_case = body.loads.parts[0].family.draw(0, 1, body.loads.parts[0].loadable)
    force = dict(zip(load_case.nodes.tolist(), load_case.forces[:, 1], strict=True))
    assert force[5] == pytest.approx(3 * force[3])  # three of the squares meet at (1, 1)


def test_a_region_of_sides_has_no_cells(tmp_path: Path) -> None:
    load = {"family": "body_force", "region": {"group": "skin"}, "range": [1, 2]}
    with pytest.raises(InputError, match="a node of it belongs to no cell of the region"):
        held(strip(tmp_path), load=load)


def test_groups_that_their_nodes_tell_are_kept_as_nodes(tmp_path: Path) -> None:
    text = STRIP.replace("{2, 4} = 2", "{2, 4} = 3")
    (tmp_path / "strip.geo").write_text(text)
    assert dict(mesh_at(tmp_path / "strip.geo").parts) == {}
    assert list(mesh_at(strip(tmp_path)).parts) == ["skin"]


@pytest.mark.parametrize("levels", [1, 2])
def test_refined(levels: int, tmp_path: Path) -> None:
    """The sides have 6 · 2ⁿ facets each; no new node of an end or of the inside is in the group."""
    mesh = refined_mesh(strip(tmp_path), levels)
    part, height = mesh.parts["skin"], mesh.coordinates[mesh.groups["skin"], 1]
    assert len(part.facets) == 12 * 2**levels
    assert np.isin(height, [0, 0.2]).all()
    assert len(height) == 2 * (6 * 2**levels + 1)
    inside = refined_mesh(frame(tmp_path), levels).parts["1"].cells
    assert len(inside) == 8 * 4**levels


def refined_mesh(path: Path, levels: int) -> RawMesh:
    case = CASE | {"mesh": {"kind": "file", "path": path.name, "refine": levels}}
    case |= {"load": {"family": "body_force", "range": [-1, 1]}}
    (path.parent / "own.yaml").write_text(yaml.safe_dump(case))
    return read_case(path.parent / "own.yaml").mesh.raw_mesh()


def test_a_dataset_holds_them(tmp_path: Path) -> None:
    body = held(strip(tmp_path))
    arrays = body.shard_arrays()
    names = arrays["mesh/group_names"].tolist()
    assert arrays["mesh/group_facets"].sum(axis=1).tolist() == [14, 12]
    assert names == ["body", "skin"]
    assert arrays["mesh/group_cells"].sum(axis=1).tolist() == [6, 0]
    datagen.body(tmp_path / "own.yaml", tmp_path / "data")
    assert check_dataset(tmp_path / "data") == []


def test_solids(tmp_path: Path) -> None:
    """A plate of hexahedra one cell thick: its rim is in neither face."""
    (tmp_path / "plate.geo").write_text(
        STRIP.split("Physical")[0] + "Extrude {0, 0, 0.1} { Surface{1}; Layers{1}; Recombine; }\n"
        'Physical Volume("body") = {1};\nPhysical Surface("faces") = {1, 6};\n'
    )
    mesh = mesh_at(tmp_path / "plate.geo")
    assert mesh.cell_type == "hexahedron"
    assert len(mesh.parts["faces"].facets) == 12
    found = solved(tmp_path / "plate.geo", "faces:1")
    assert np.abs(found.force[:, :2]).max() < 1e-12
