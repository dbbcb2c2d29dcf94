"""gmsh scripts that act outside gmsh are refused before gmsh sees them, unless trusted."""

from __future__ import annotations

from pathlib import Path

import pytest

from datagen.cases.case import SHIPPED, read_case
from datagen.mesh.files.gmsh_script import require_harmless
from datagen.mesh.mesh_file import MeshFile
from shared_schema.common.errors import InputError
from tests.datagen.mesh.test_mesh_file import SQUARE, write_case
from tests.datagen.refusal import refusal

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
