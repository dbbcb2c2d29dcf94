"""A user's own load family: found from the case file, believed only as far as it is right."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import yaml
from mpi4py import MPI

from datagen.cases.case import SHIPPED, read_case
from datagen.command_line import main
from datagen.farm.farm import run
from datagen.transforms.reindexing import structure
from shared_schema.checker import check_dataset
from shared_schema.common.errors import InputError
from shared_schema.loads import DrawnLoads
from shared_schema.manifest import read_manifest
from shared_schema.shard import read_shard
from tests.datagen.farm_runs import execute
from tests.datagen.loads.test_loads import place
from tests.datagen.refusal import refusal

CODE = """
from __future__ import annotations

import numpy as np

from datagen.loads import LoadCase, LoadFamily


class Push(LoadFamily):
    newtons: float = 0.1

    def draw(self, number, seed, loadable):
        nodes, forces = loadable.nodes, np.full((len(loadable), loadable.dimension), self.newtons)
        {draw}
        return LoadCase(nodes, forces)

    def loads_per_sample(self, loadable):
        return {most}
"""


def write_family(folder: Path, draw: str = "pass", most: str = "len(loadable)") -> Path:
    path = folder / "push.py"
    path.write_text(CODE.format(draw=draw, most=most))
    return path


def write_case(folder: Path, samples: int = 4) -> Path:
    """A beam with the load family of ``push.py`` beside the case file."""
    content = yaml.safe_load((SHIPPED / "beam2d.yaml").read_text())
    content["dataset"] |= {"samples": samples, "shard_size": 2}
    content["load"] = {"family": "push.py:Push", "region": {"x": 4}}
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of the case, from another working folder."""
    (tmp_path / "working").mkdir()
    (tmp_path / "case").mkdir()
    monkeypatch.chdir(tmp_path / "working")
    return tmp_path / "case"


def test_the_path_is_that_from_the_case_file(elsewhere: Path) -> None:
    write_family(elsewhere)
    Path("push.py").write_text("raise SystemExit('the one in the working folder')")
    case = read_case(str(write_case(elsewhere)))
    run(case, elsewhere / "nodal", comm=MPI.COMM_SELF)
    shard = read_shard(elsewhere / "nodal" / "shard-00000.h5", "nodal")
    assert np.all(shard["samples/force"] == 0.1)
    assert shard["samples/loaded_nodes"].shape == (2, 4)


@pytest.mark.parametrize(
    ("draw", "said"),
    [
        ("nodes = nodes - nodes - 1", "sample 0: node -1 is loaded, expected some of the 4 nodes"),
        ("nodes = nodes * 0", "sample 0: node 0 is loaded"),  # clamped
        ("nodes = nodes + 1000", "is loaded, expected some of the 4 nodes of the region"),
        ("nodes = nodes * 1.0", r"nodes have type float64 and shape \(4,\), expected int"),
        ("nodes = nodes[:, None]", r"nodes have type int64 and shape \(4, 1\), expected int and"),
        ("nodes = nodes > 0", "nodes have type bool"),
        ("forces = forces[:, :1]", r"forces have type float64 and shape \(4, 1\), expected .*4, 2"),
        ("forces = np.full((4, 3), 0.1)", r"shape \(4, 3\), expected float and \(4, 2\)"),
        ("forces = forces[:2]", r"shape \(2, 2\), expected float and \(4, 2\)"),
        ("forces[1, 1] = np.nan", "a force component is nan N, expected at most 1e[+]12 N"),
        ("forces[1, 1] = -np.inf", "a force component is -inf N"),
        ("forces = forces.astype(str)", "forces have type <U32"),
        ("forces = [[0.1], [0.1, 0.2]]", "no array"),
        ("return None", "draw returned None, expected a LoadCase"),
        ("raise KeyError('wind')", r"sample 0: draw: KeyError: 'wind' \(line 14\)"),
        ("raise SystemExit(0)", r"sample 0: draw: SystemExit: 0 \(line 14\)"),
        ("self.newtons = 3", "sample 0: draw: ValidationError"),
    ],
)
def test_what_is_drawn_is_not_believed(
    elsewhere: Path, capsys: pytest.CaptureFixture[str], draw: str, said: str
) -> None:
    """Exit code 2 and one line that names family and sample; nothing is written."""
    write_family(elsewhere, draw)
    words = ["run", str(write_case(elsewhere)), "--out", str(elsewhere / "nodal")]
    with pytest.raises(InputError, match=said):
        raise InputError(refusal(words, capsys))
    assert not (elsewhere / "nodal").exists()


@pytest.mark.parametrize("most", ["3", "0", "-1", "None", "1.5", "True", "10**30", "1 / 0"])
def test_wrong_numbers_of_loads(
    elsewhere: Path, capsys: pytest.CaptureFixture[str], most: str
) -> None:
    write_family(elsewhere, most=most)
    words = ["run", str(write_case(elsewhere)), "--out", str(elsewhere / "nodal")]
    said = refusal(words, capsys)
    assert "load family 'push.py:Push'" in said
    assert "loads_per_sample" in said
    assert not (elsewhere / "nodal").exists()


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import no_such_module", "cannot be imported: ModuleNotFoundError: No module named 'no_s"),
        ("\n\n1 / 0", "cannot be imported: ZeroDivisionError: division by zero (line 3)"),
        ("raise SystemExit", "cannot be imported: SystemExit"),
        ("def (", "cannot be imported: SyntaxError"),
        ("", "has no class 'Push'"),
        ("Push = 3", "expected a subclass of LoadFamily"),
        (None, "cannot be read (No such file or directory)"),
    ],
)
def test_files_that_are_no_family(
    elsewhere: Path, capsys: pytest.CaptureFixture[str], code: str | None, said: str
) -> None:
    if code is not None:
        (elsewhere / "push.py").write_text(code)
    words = ["run", str(write_case(elsewhere)), "--out", str(elsewhere / "nodal")]
    error = refusal(words, capsys)
    assert "load family 'push.py:Push'" in error
    assert said in error
    assert not (elsewhere / "nodal").exists()


def test_a_node_twice_is_the_sum_everywhere(elsewhere: Path) -> None:
    """Solver, dataset and grid get the same forces: 0.1 + 0.2 N at one node."""
    write_family(elsewhere, "return LoadCase(nodes[[0, 0]], forces[:2] * [[1.0], [2.0]])")
    run(read_case(str(write_case(elsewhere))), elsewhere / "nodal", comm=MPI.COMM_SELF)
    structure(elsewhere / "nodal", elsewhere / "grid")
    shard = read_shard(elsewhere / "nodal" / "shard-00000.h5", "nodal")
    assert shard["samples/force"][0, 0] == pytest.approx([0.3, 0.3])
    assert shard["samples/loaded_nodes"][0, 1:].tolist() == [-1, -1, -1]
    grid = read_shard(elsewhere / "grid" / "shard-00000.h5", "structured")
    assert grid["samples/force"][0].sum(axis=(1, 2)) == pytest.approx([0.3, 0.3])
    write_family(elsewhere, "return LoadCase(nodes[:1], forces[:1] * 3)")
    other = elsewhere / "once"
    run(read_case(str(write_case(elsewhere))), other, comm=MPI.COMM_SELF)
    once = read_shard(other / "shard-00000.h5", "nodal")
    difference = once["samples/displacement"] - shard["samples/displacement"]
    assert np.abs(difference).max() < 1e-12


@pytest.mark.mpi
def test_a_wrong_load_later_on_keeps_what_is_solved(elsewhere: Path) -> None:
    """Exit code 2 and one line from all ranks; the mended family is another version of the file."""
    write_family(elsewhere, "if number == 7: nodes = nodes - 5")
    case_file, out = write_case(elsewhere, samples=10), elsewhere / "nodal"
    result = execute(2, case_file, out)
    assert result.returncode == 2
    assert result.stderr.count("error:") == 1
    assert "load family 'push.py:Push': sample 7: node" in result.stderr
    assert "Traceback" not in result.stderr
    assert list(out.glob("shard-*.h5"))
    write_family(elsewhere)
    with pytest.raises(InputError, match=r"the file of load.family = 'push.py:Push' has changed"):
        run(read_case(str(case_file)), out, comm=MPI.COMM_SELF)


def test_the_case_may_name_the_checksum(elsewhere: Path) -> None:
    write_family(elsewhere)
    path = write_case(elsewhere)
    content = yaml.safe_load(path.read_text())
    path.write_text(
        yaml.safe_dump(content | {"load": content["load"] | {"family_sha256": "0" * 64}})
    )
    with pytest.raises(
        InputError, match=r"push.py:Push': key 'family_sha256' = '0+', the file has"
    ):
        read_case(str(path))


def test_a_dataset_is_read_without_its_family(elsewhere: Path) -> None:
    """`structure` from another folder, after the file is gone or has become a trap."""
    write_family(elsewhere)
    path = write_case(elsewhere)
    assert main(["run", str(path), "--out", str(elsewhere / "nodal")]) == 0
    manifest = read_manifest(elsewhere / "nodal")
    assert manifest.case["load"]["family"] == "push.py:Push"
    trap = "import pathlib; pathlib.Path('sprung').touch(); raise SystemExit(0)"
    for file in (elsewhere / "push.py", Path("push.py")):
        file.write_text(trap)
    os.chdir(elsewhere)
    for words in (
        ["check", "nodal"],
        ["info", "nodal"],
        ["structure", "nodal", "--out", "grid"],
        ["noise", "nodal", "--out", "noisy"],
        ["plot", "nodal", "--out", "figure.png"],
        ["export", "nodal", "--out", "series.pvd"],
    ):
        assert main(words) == 0
    assert check_dataset(Path("grid")) == []
    assert not list(elsewhere.parent.rglob("sprung"))


def test_shipped_families_are_what_a_load_case_may_be() -> None:
    """Every sample passes the same check, to the last bit what the family draws."""
    loads = DrawnLoads(read_case("beam2d").loads[0], 7, place({"y": 1.0, "x": "> 0"}))
    loads.check()
    for number in range(20):
        drawn = loads.family.draw(number, 7, loads.loadable)
        assert np.array_equal(loads[number].forces, drawn.forces)
        assert np.array_equal(loads[number].nodes, drawn.nodes)
