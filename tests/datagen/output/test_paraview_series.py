"""Exported time series, read back by meshio, against the shards; no other file changes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
from meshio.xdmf import TimeSeriesReader
from mpi4py import MPI

from datagen.cases.case import Case, read_case
from datagen.command_line import main
from datagen.farm.farm import run
from datagen.output import paraview_series as module
from datagen.output.nodal_samples import Sample
from datagen.output.paraview_series import export
from shared_schema.common.errors import InputError
from shared_schema.layout import Arrays
from shared_schema.manifest import read_manifest
from shared_schema.shard import read_shard
from tests.datagen.farm_runs import datagen, finish
from tests.datagen.refusal import refusal
from tools.small_disk import SmallDisk

Steps = dict[int, dict[str, np.ndarray]]


def beam_in_shards_of_five() -> Case:
    case = read_case("beam2d", samples=12)
    dataset = case.dataset.model_copy(update={"shard_size": 5})
    return case.model_copy(update={"dataset": dataset})


@pytest.fixture(scope="module")
def beam(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """12 samples in three shards."""
    folder = tmp_path_factory.mktemp("export") / "beam"
    run(beam_in_shards_of_five(), folder, comm=MPI.COMM_SELF)
    return folder


def shards(folder: Path) -> list[Arrays]:
    return [read_shard(folder / entry.file, "nodal") for entry in read_manifest(folder).shards]


def in_shards(folder: Path) -> Steps:
    """Nodal fields of every sample by sample number, padded with a zero third component."""
    steps: Steps = {}
    for shard in shards(folder):
        for row, number in enumerate(shard["samples/number"].tolist()):
            displacement = np.zeros((len(shard["mesh/coordinates"]), 3))
            displacement[:, :2] = shard["samples/displacement"][row]
            force = np.zeros_like(displacement)
            node = shard["samples/loaded_nodes"][row, 0]
            force[node, :2] = shard["samples/force"][row, 0]
            steps[number] = {"displacement": displacement, "force": force}
    return steps


def read_series(path: Path) -> tuple[np.ndarray, list[meshio.CellBlock], Steps]:
    """Read points, cells, and fields by time of an exported series with meshio."""
    steps: Steps = {}
    if path.suffix == ".xdmf":
        with TimeSeriesReader(path) as reader:
            points, cells = reader.read_points_cells()
            for step in range(reader.num_steps):
                time, fields, _ = reader.read_data(step)
                steps[int(time)] = fields
        return points, cells, steps
    for entry in ElementTree.parse(path).getroot().iter("DataSet"):
        mesh = meshio.read(path.parent / entry.attrib["file"])
        steps[int(entry.attrib["timestep"])] = mesh.point_data
    return mesh.points, mesh.cells, steps


def everything_in(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


@pytest.mark.parametrize("suffix", [".xdmf", ".pvd"])
def test_meshio_reads_the_arrays_of_the_shards(beam: Path, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"beam{suffix}"
    assert export(beam, path) == list(range(12))
    points, cells, steps = read_series(path)
    shard, expected = shards(beam)[0], in_shards(beam)
    np.testing.assert_array_equal(points[:, :2], shard["mesh/coordinates"])
    assert not points[:, 2].any()
    assert [block.type for block in cells] == ["quad"]
    np.testing.assert_array_equal(cells[0].data, shard["mesh/cells"])
    assert list(steps) == list(range(12))
    for number, fields in steps.items():
        assert sorted(fields) == ["displacement", "force"]
        for name, values in fields.items():
            assert values.dtype == np.float64
            np.testing.assert_array_equal(values, expected[number][name])


def test_in_space(tmp_path: Path) -> None:
    case = read_case("beam3d", samples=1)
    geometry = case.mesh.model_copy(update={"elements": (4, 1, 1)})
    folder = tmp_path / "nodal"
    run(case.model_copy(update={"mesh": geometry}), folder, comm=MPI.COMM_SELF)
    for suffix in (".xdmf", ".pvd"):
        export(folder, tmp_path / f"beam{suffix}")
        _, cells, steps = read_series(tmp_path / f"beam{suffix}")
        assert cells[0].type == "hexahedron"
        shard = shards(folder)[0]
        np.testing.assert_array_equal(steps[0]["displacement"], shard["samples/displacement"][0])
        assert steps[0]["force"].sum(axis=0).tolist() == shard["samples/force"][0, 0].tolist()


@pytest.mark.parametrize("suffix", [".xdmf", ".pvd"])
def test_range_of_samples(beam: Path, tmp_path: Path, suffix: str) -> None:
    """A half-open range over two shards; a second export replaces the files of the first."""
    path = tmp_path / f"beam{suffix}"
    export(beam, path, samples="0:12")
    export(beam, path, samples="3:7")
    _, _, steps = read_series(path)
    assert list(steps) == [3, 4, 5, 6]
    expected = {
        ".xdmf": ["beam.h5", "beam.xdmf"],
        ".pvd": ["beam", "beam.pvd", *(f"beam/sample-{n:05d}.vtu" for n in range(3, 7))],
    }
    assert everything_in(tmp_path) == expected[suffix]


def test_default_is_the_first_samples(
    beam: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert module.FIRST == 100
    monkeypatch.setattr(module, "FIRST", 4)
    assert export(beam, tmp_path / "a.xdmf") == [0, 1, 2, 3]


def test_series_can_be_moved(beam: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The names in a file are relative to that file, whatever the working folder was."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    export(beam, Path("../a.xdmf"), samples="0:2")
    assert everything_in(tmp_path) == ["a.h5", "a.xdmf", "here"]
    (tmp_path / "there").mkdir()
    for name in ("a.h5", "a.xdmf"):
        (tmp_path / name).rename(tmp_path / "there" / name)
    assert list(read_series(tmp_path / "there" / "a.xdmf")[2]) == [0, 1]


@pytest.mark.parametrize(
    ("samples", "said"),
    [
        ("5:5", "0 <= A < B <= 12"),
        ("0:13", "0 <= A < B <= 12"),
        ("7:3", "0 <= A < B <= 12"),
        ("3", "expected A:B"),
        ("-1:3", "expected A:B"),
        ("a:b", "expected A:B"),
        ("", "expected A:B"),
    ],
)
def test_wrong_ranges(
    beam: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], samples: str, said: str
) -> None:
    out = str(tmp_path / "a.pvd")
    error = refusal(["export", str(beam), "--out", out, f"--samples={samples}"], capsys)
    assert said in error
    assert f"--samples '{samples}'" in error
    assert everything_in(tmp_path) == []


@pytest.mark.parametrize("out", ["a.vtu", "missing/a.xdmf", "a:b.xdmf", ".pvd"])
def test_wrong_names(
    beam: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], out: str
) -> None:
    refusal(["export", str(beam), "--out", str(tmp_path / out)], capsys)
    assert everything_in(tmp_path) == []


def test_other_files_are_not_replaced(beam: Path, tmp_path: Path) -> None:
    """A shard, the folder of the dataset, a folder with a text file, a link."""
    before = {path: path.read_bytes() for path in beam.iterdir()}
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "todo.txt").write_text("export")
    (tmp_path / "link.h5").symlink_to(beam / "shard-00000.h5")
    for path in (
        beam / "shard-00000.xdmf",
        beam.with_suffix(".pvd"),
        tmp_path / "notes.pvd",
        tmp_path / "link.xdmf",
    ):
        with pytest.raises(InputError, match="holds something else"):
            export(beam, path)
    assert {path: path.read_bytes() for path in beam.iterdir()} == before
    assert everything_in(tmp_path) == ["link.h5", "notes", "notes/todo.txt"]


@pytest.mark.parametrize("suffix", [".xdmf", ".pvd"])
@pytest.mark.parametrize("kind", [OSError, KeyboardInterrupt])
def test_failure_leaves_the_old_series(
    beam: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    suffix: str,
    kind: type[BaseException],
) -> None:
    """An export that fails at its third sample leaves the old files as they were, and no others."""
    path = tmp_path / f"beam{suffix}"
    export(beam, path, samples="0:5")
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    original = module._fields

    def fields(sample: Sample) -> module.Fields:
        if sample.number == 8:
            raise kind("no space left")
        return original(sample)

    monkeypatch.setattr(module, "_fields", fields)
    with pytest.raises(kind, match="no space left"):
        export(beam, path, samples="6:11")
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before
    assert list(read_series(path)[2]) == [0, 1, 2, 3, 4]


@pytest.mark.faults
def test_full_disk_is_exit_1_and_one_line(beam: Path, tmp_path: Path) -> None:
    """No file over 16 KiB can be written; the arrays are 12 · 2 · 64 · 3 · 8 B = 36 KiB."""
    out = tmp_path / "a.xdmf"
    command = [sys.executable, "-m", "datagen.command_line", "export", str(beam)]
    limited = ["bash", "-c", 'ulimit -f 16; exec "$@"', "bash", *command, "--out", str(out)]
    result = subprocess.run(limited, capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert result.stderr.endswith(f"\ndatagen: failed: [Errno 27] File too large: '{out}'\n")
    assert everything_in(tmp_path) == []


@pytest.mark.faults
@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["xdmf", "pvd"])
def test_a_disk_that_is_full_somewhere(beam: Path, tmp_path: Path, suffix: str) -> None:
    """From no room to enough, in steps: one line that names the target, and nothing is left."""
    codes = []
    for size in (1, 64, 300, 1000):
        disk = SmallDisk(tmp_path / f"disk-{size}", f"size={size}k")
        out = disk.folder / f"a.{suffix}"
        result = finish(disk.words(datagen("export", beam, "--out", out)))
        codes.append(result.returncode)
        if result.returncode:
            assert (result.returncode, list(disk.seen.iterdir())) == (1, [])
            line = result.stderr.splitlines()[-1]
            assert line.startswith("datagen: failed: [Errno 28] No space left on device:")
            assert f"'{disk.folder / 'a'}" in line
        disk.close()
    assert codes[0] == 1
    assert codes == sorted(codes, reverse=True)
    assert codes[-1] == 0


def test_structured_dataset(beam: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grid = tmp_path / "grid"
    assert main(["structure", str(beam), "--out", str(grid)]) == 0
    capsys.readouterr()
    assert main(["export", str(grid), "--out", str(tmp_path / "a.pvd")]) == 2
    assert "a structured dataset, expected a nodal one" in capsys.readouterr().err
