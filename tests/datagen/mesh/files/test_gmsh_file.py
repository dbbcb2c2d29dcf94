"""gmsh meshes: groups of equal names, numbers, endings in capitals; scripts that act outside."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest
import yaml

from datagen.cases.case import SHIPPED, read_case
from datagen.cases.placed_body import PlacedBody, placed
from datagen.mesh.files.gmsh_file import require_harmless
from datagen.mesh.mesh_file import MeshFile
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.errors import InputError
from tests.datagen.mesh.test_mesh_file import CASE, SQUARE, mesh_at, volume, write_case
from tests.datagen.refusal import refusal

NODES = "1 0 0 0\n2 1 0 0\n3 2 0 0\n4 0 1 0\n5 1 1 0\n6 2 1 0\n"
EQUAL = """SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 2, 1};
Physical Curve(1) = {4}; Physical Surface(1) = {1};
Physical Point("end") = {2}; Physical Curve("end") = {2};
Mesh.MeshSizeMax = 0.5;
"""
SCRIPTS = {
    "SystemCall": 'SystemCall "touch pwned";',
    "System": 'System "touch pwned";',
    "NonBlockingSystemCall": 'NonBlockingSystemCall "touch pwned";',
    "OnelabRun": 'OnelabRun("x", "touch pwned");',
    "ExternalProcess": 'Field[1] = ExternalProcess; Field[1].CommandLine = "touch pwned";',
    "Printf": 'Printf("x") > "pwned";',
    "Printf(": 'Printf("a)", 1)\n/* */ >> "pwned";',
    "Save": 'Save "pwned.msh";',
    "CreateDir": 'CreateDir "pwned";',
    "Include": 'Include "other.txt";',
    "Merge": 'Merge "other.txt";',
    "Plugin": "Plugin(MathEval).Run;",
    "FileName": 'Field[1] = Structured; Field[1].FileName = "other.txt";',
    "GetValue": 'x = GetValue("how many?", 3);',
    # as gmsh reads them: a NUL ends a comment, comments do not nest, a backslash ends no string
    "\\x00": '// a word \0 SystemCall "touch pwned";',
    "SystemCall/": '/* a /* b */ SystemCall "touch pwned"; /* */',
    "SystemCall\\": 'a = "x\\"; SystemCall "touch pwned"; b = "";',
    "'": 'a = \'"\'; Save StrCat("pw", "ned.msh"); b = \'"\';',
}


def msh2(path: Path, elements: list[str], nodes: str = NODES) -> Path:
    """Write a gmsh mesh of format 2, by default of the six nodes of two squares."""
    count = nodes.count("\n")
    path.write_text(
        f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{count}\n{nodes}$EndNodes\n"
        f"$Elements\n{len(elements)}\n" + "\n".join(elements) + "\n$EndElements\n"
    )
    return path


def case_at(path: Path, **changes: Any) -> PlacedBody:
    """Body of a case with a mesh file."""
    load = {"family": "body_force", "range": [-1, 1]}
    content = CASE | {"mesh": {"kind": "file", "path": path.name}, "load": load} | changes
    (path.parent / "own.yaml").write_text(yaml.safe_dump(content))
    case = read_case(path.parent / "own.yaml")
    return placed(case, case.mesh.raw_mesh())


def two_squares(mesh: RawMesh) -> bool:
    return mesh.cell_type == "quad" and len(mesh.cells) == 2 and volume(mesh) == 2


def test_the_place_says_which_group_of_a_number(tmp_path: Path) -> None:
    """Curve 1 is the left side, surface 1 the whole: supports and tractions mean the former."""
    path = tmp_path / "own.geo"
    path.write_text(EQUAL)
    material = [{"group": "1", "young_modulus": 500, "poisson_ratio": 0.4}]
    body = case_at(path, supports=[{"group": "1"}], material=material)
    x = body.mesh.coordinates
    assert np.array_equal(body.clamped, x[:, 0] < 1e-9)
    assert body.parts is not None
    assert len(body.parts) == len(body.mesh.cells)
    assert len(body.mesh.groups["surface 1"]) == len(x)
    load = {"family": "traction", "region": {"group": "1"}, "range": [-1, 1]}
    pulled = case_at(path, supports=[{"group": "curve 1", "y": "> 0.5"}, {"x": 2}], load=load)
    assert np.array_equal(pulled.loadable, (x[:, 0] < 1e-9) & (x[:, 1] <= 0.5))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"load": {"family": "random_node", "region": {"group": "1"}, "range": [-1, 1]}},
            "key 'load.region': group '1': the mesh has several, expected one of curve 1, surf",
        ),
        (
            {"supports": [{"group": "end"}]},
            "key 'supports.0': group 'end': the mesh has several, expected one of point end, curve",
        ),
    ],
)
def test_a_place_that_does_not_say_which(
    changes: dict[str, Any], said: str, tmp_path: Path
) -> None:
    (tmp_path / "own.geo").write_text(EQUAL)
    with pytest.raises(InputError, match=said):
        case_at(tmp_path / "own.geo", **({"supports": [{"group": "1"}]} | changes))


def test_endings_in_capitals(tmp_path: Path) -> None:
    """A script in capitals is meshed, and the meshes that gmsh writes of it keep its groups."""
    (tmp_path / "own.GEO").write_text(SQUARE + 'Physical Surface("all") = {1};\n')
    ours = mesh_at(tmp_path / "own.GEO")
    assert volume(ours) == pytest.approx(2)
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.open(str(tmp_path / "own.GEO"))
    gmsh.model.mesh.generate(2)
    for version in (2.2, 4.1):
        for binary in (0, 1):
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", binary)
            gmsh.write(str(tmp_path / f"own{version}{binary}.msh"))
    gmsh.finalize()
    for path in tmp_path.glob("own*.msh"):
        read = mesh_at(path.rename(path.with_suffix(".MSH")))
        assert sorted(read.groups) == sorted(ours.groups) == ["7", "all", "left", "right"], path
        np.testing.assert_array_equal(read.groups["left"], ours.groups["left"])
        np.testing.assert_allclose(read.coordinates, ours.coordinates, atol=1e-15)
        assert {*map(tuple, read.cells)} == {*map(tuple, ours.cells)}
    (tmp_path / "own.GEO").write_text('SystemCall "true";\n')
    with pytest.raises(InputError, match="'SystemCall' can run programs"):
        mesh_at(tmp_path / "own.GEO")


def test_cells_in_several_groups_and_entities_with_several(tmp_path: Path) -> None:
    """A cell stands there once for each of its groups; a group is of elements, not of entities."""
    path = msh2(
        tmp_path / "own.msh",
        ["1 3 2 7 1 1 2 5 4", "2 3 2 9 1 1 2 5 4", "3 3 2 9 1 2 3 6 5", "4 1 2 7 4 1 4"],
    )
    mesh = mesh_at(path)
    assert two_squares(mesh)
    assert {name: cells.tolist() for name, cells in mesh.cell_groups.items()} == {
        "7": [0],
        "9": [0, 1],
    }
    assert mesh.groups["curve 7"].tolist() == [0, 3]
    assert mesh.groups["surface 7"].tolist() == [0, 1, 3, 4]
    assert len(mesh.groups["9"]) == 6


@pytest.mark.parametrize(
    ("elements", "said"),
    [
        (["1 3 2 0 1 2 3 6 5", "1 3 2 0 1 1 2 5 4"], "element 1 stands there 2 times"),
        (["1 3 2 5 1 2 3 6 5", "8 3 2 5 1 6 5 2 3"], "elements 1, 8: the same nodes"),
        (["1 3 2 0 1 2 3 6 9"], "node 9 of an element is not in the file"),
        (["1 3 2 0 1 2 3 6"], "element 1 has 3 nodes"),
    ],
)
def test_wrong_elements(elements: list[str], said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rf"key 'mesh.path' = 'own.msh': .*{said}"):
        mesh_at(msh2(tmp_path / "own.msh", elements))


def test_numbers_of_other_formats(tmp_path: Path) -> None:
    """Of two elements with one number gmsh drops the second in format 1, and reads both in 4."""
    squares = "1 2 5 4\n", "2 3 6 5\n"
    (tmp_path / "own.msh").write_text(
        f"$NOD\n6\n{NODES}$ENDNOD\n$ELM\n2\n"
        + "".join(f"1 3 0 1 4 {square}" for square in squares)
        + "$ENDELM\n"
    )
    with pytest.raises(InputError, match="the file has 2 elements, of which gmsh reads 1"):
        mesh_at(tmp_path / "own.msh")
    (tmp_path / "own.msh").write_text(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
        "$Nodes\n1 6 1 6\n2 1 0 6\n1\n2\n3\n4\n5\n6\n"
        + "".join(line[2:] + "\n" for line in NODES.splitlines())
        + "$EndNodes\n$Elements\n1 2 1 1\n2 1 3 2\n"
        + "".join(f"1 {square}" for square in squares)
        + "$EndElements\n"
    )
    with pytest.raises(InputError, match="element 1 stands there 2 times, expected once"):
        mesh_at(tmp_path / "own.msh")


@pytest.mark.parametrize("shuffled", [False, True])
def test_node_numbers_with_gaps(shuffled: bool, tmp_path: Path) -> None:
    """The left side has the numbers 10 and 40, in whatever place of the file they stand."""
    lines = NODES.replace("\n", "\n|").split("|")[:-1]
    lines = [f"{10 * int(line[0])}{line[1:]}" for line in lines]
    order = [5, 0, 3, 1, 4, 2] if shuffled else range(6)
    elements = ["1 3 2 0 1 10 20 50 40", "2 3 2 0 1 20 30 60 50"]
    path = msh2(tmp_path / "own.msh", elements, "".join(lines[n] for n in order))
    body = case_at(path, supports=[{"nodes": [10, 40], "nodes_from": 1}])
    assert np.array_equal(body.clamped, body.mesh.coordinates[:, 0] == 0)
    with pytest.raises(
        InputError, match=r"nodes_from = 0: .* with gaps or out of order, expected 1"
    ):
        case_at(path, supports=[{"nodes": [0, 3], "nodes_from": 0}])
    with pytest.raises(InputError, match="node 11: belongs to no cell"):
        case_at(path, supports=[{"nodes": [11], "nodes_from": 1}])


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_that_acts_outside(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exit code 2, the line and the command are named; nothing is run or written."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other.txt").write_text('SystemCall "touch pwned";\n')
    path = write_case(tmp_path, SQUARE + SCRIPTS[name] + "\n")
    before = sorted(tmp_path.iterdir())
    for words in (["run", path, "--out", "nodal"], ["solve", path, "--load", "1,1:0,1"]):
        out = [] if "--out" in words else ["--out", "u.npz"]
        said = refusal([*words, *out], capsys)
        assert "key 'mesh.path' = 'own.geo': line " in said
        assert name.rstrip("(/\\") in said
        assert "--trust" in said
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("begin", ["", "\n\n", "$Mesh\n"])
def test_a_script_that_calls_itself_a_mesh(begin: str, tmp_path: Path) -> None:
    """gmsh runs any file that does not begin as a mesh does."""
    (tmp_path / "own.msh").write_text(f'{begin}SystemCall "touch {tmp_path}/pwned";\n')
    with pytest.raises(InputError, match="expected a mesh, which begins with"):
        MeshFile(kind="file", path="own.msh").found_from(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["own.msh"]


def test_a_trusted_script(tmp_path: Path) -> None:
    command = f'SystemCall "touch {tmp_path}/ran";\n'
    read_case(write_case(tmp_path, SQUARE + command), trust=True).mesh.raw_mesh()
    assert (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    "text",
    [
        "// Print, Save and Merge: words of a comment\n",
        '/* Include */ Physical Point("Save") = {1};\n',
        'Printf("%g > %g", 1, 2);\n',
        "Mesh.SaveAll = 1; a = 3 > 2;\n",
        'Field[1] = MathEval; Field[1].F = "0.1";\n',
    ],
)
def test_harmless_scripts(text: str, tmp_path: Path) -> None:
    path = tmp_path / "own.geo"
    path.write_text(SQUARE + text)
    require_harmless(path)


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.geo")), ids=lambda path: path.name)
def test_shipped_scripts(path: Path) -> None:
    require_harmless(path)
