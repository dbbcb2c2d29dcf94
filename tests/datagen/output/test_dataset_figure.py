"""Choice of the samples, text of the panels, and wrong input of `datagen plot`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from matplotlib.image import imread
from mpi4py import MPI

from datagen.cases.case import read_case
from datagen.command_line import main
from datagen.farm.farm import run
from datagen.output.dataset_figure import draw, resultant_of
from datagen.output.nodal_samples import DatasetBody, NodalSamples
from shared_schema.dataset_reader import DatasetReader
from shared_schema.shard import read_shard
from tests.datagen.mesh.test_mesh_file import CASE
from tests.datagen.refusal import refusal

STARTS = {"png": b"\x89PNG\r\n", "pdf": b"%PDF-", "svg": b"<?xml"}


@pytest.fixture(scope="module")
def beam(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("figure") / "nodal"
    run(read_case("beam2d", samples=10), folder, comm=MPI.COMM_SELF)
    return folder


def test_samples_are_chosen_evenly_by_displacement(beam: Path) -> None:
    """Ten samples give those of rank ⌈10 k / 4⌉ by displacement: 3rd, 5th, 8th and 10th."""
    samples = NodalSamples(beam)
    shard = read_shard(beam / "shard-00000.h5", "nodal")
    moved = np.linalg.norm(shard["samples/displacement"], axis=2).max(axis=1)
    assert samples.largest == pytest.approx(moved)
    assert samples.evenly_by_displacement(4) == np.argsort(moved)[[2, 4, 7, 9]].tolist()
    assert samples.evenly_by_displacement(1) == [moved.argmax()]
    assert samples.evenly_by_displacement(99) == np.argsort(moved).tolist()


def test_a_sample_is_that_of_the_shard(beam: Path) -> None:
    sample, shard = NodalSamples(beam)[7], read_shard(beam / "shard-00000.h5", "nodal")
    np.testing.assert_array_equal(sample.displacement, shard["samples/displacement"][7])
    node = shard["samples/loaded_nodes"][7, 0]
    np.testing.assert_array_equal(sample.force[node], shard["samples/force"][7, 0])
    assert np.count_nonzero(sample.force.any(axis=1)) == 1


def test_panels(beam: Path) -> None:
    """The mesh, a panel for each sample with number, displacement and force, and the legend."""
    dataset = NodalSamples(beam)
    samples = [dataset[number] for number in (3, 0, 8)]
    mesh, *panels, key = draw(dataset, samples).axes
    assert mesh.get_xlabel() == "x [m]"
    marked = [np.asarray(marks.get_offsets()) for marks in mesh.collections[1:]]
    np.testing.assert_array_equal(marked[0], dataset.coordinates[dataset.clamped])
    np.testing.assert_array_equal(marked[1], dataset.coordinates[dataset.loadable])
    for panel, sample in zip(panels, samples, strict=True):
        moved = np.linalg.norm(sample.displacement, axis=1).max()
        assert panel.get_title() == f"sample {sample.number}: displaced by up to {moved:.3g} m"
        (said,) = (text.get_text() for text in panel.texts if text.get_text())
        assert said == f"{np.linalg.norm(sample.force):.3g} N"
        assert panel.get_xlim() == mesh.get_xlim()
        assert panel.get_ylim() == panels[0].get_ylim()
    legend = key.get_legend()
    assert legend is not None
    assert legend.get_title().get_text() == "beam2d: 10 samples\n64 nodes, 45 quadrilaterals"


@pytest.mark.parametrize("suffix", sorted(STARTS))
def test_plot(beam: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], suffix: str) -> None:
    out = tmp_path / f"a.{suffix}"
    assert main(["plot", str(beam), "--out", str(out), "--samples", "4,2"]) == 0
    assert capsys.readouterr().out == f"{out}: samples 4, 2\n"
    assert out.read_bytes().startswith(STARTS[suffix])
    assert [path.name for path in tmp_path.iterdir()] == [out.name]


def test_info_draws_the_same_figure(
    beam: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, other = tmp_path / "one.png", tmp_path / "other.png"
    assert main(["plot", str(beam), "--out", str(one)]) == 0
    capsys.readouterr()
    assert main(["info", str(beam), "--figure", str(other)]) == 0
    assert "10 solved, 0 failed" in capsys.readouterr().out
    np.testing.assert_array_equal(imread(one), imread(other))


def test_in_space(tmp_path: Path) -> None:
    """A 3D dataset with fewer samples than the default number of panels."""
    case = read_case("beam3d", samples=2)
    geometry = case.mesh.model_copy(update={"elements": (4, 2, 2)})
    run(case.model_copy(update={"mesh": geometry}), tmp_path / "nodal", comm=MPI.COMM_SELF)
    out = tmp_path / "a.png"
    assert main(["plot", str(tmp_path / "nodal"), "--out", str(out)]) == 0
    assert len(np.unique(imread(out).reshape(-1, 4), axis=0)) > 50


@pytest.mark.parametrize(
    ("samples", "said"),
    [
        ("10", "no sample 10 was solved, expected numbers of solved ones, 0 to 9"),
        ("1,1", "expected each sample number once"),
        ("1,", "expected sample numbers N,N"),
        ("1:3", "expected sample numbers N,N"),
        ("-1", "expected sample numbers N,N"),
        ("", "expected sample numbers N,N"),
    ],
)
def test_wrong_samples(
    beam: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], samples: str, said: str
) -> None:
    out = str(tmp_path / "a.png")
    error = refusal(["plot", str(beam), "--out", out, f"--samples={samples}"], capsys)
    assert f"--samples '{samples}': {said}" in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.jpg", "a", "missing/a.png"])
def test_wrong_names(
    beam: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    out = str(tmp_path / name)
    assert main(["plot", str(beam), "--out", out]) == 2
    assert f"--out '{out}'" in capsys.readouterr().err
    assert main(["info", str(beam), "--figure", out]) == 2
    captured = capsys.readouterr()
    assert f"--figure '{out}'" in captured.err
    assert captured.out == ""
    assert list(tmp_path.iterdir()) == []


def test_structured_dataset(beam: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grid, out = str(tmp_path / "grid"), tmp_path / "a.png"
    assert main(["structure", str(beam), "--out", grid]) == 0
    for command in (["plot", grid, "--out", str(out)], ["info", grid, "--figure", str(out)]):
        capsys.readouterr()
        assert main(command) == 2
        assert "a structured dataset, expected a nodal one" in capsys.readouterr().err
    assert not out.exists()


def test_body_without_samples(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    body, out = tmp_path / "body", tmp_path / "body.png"
    assert main(["body", "beam2d", "--out", str(body)]) == 0
    capsys.readouterr()
    assert main(["plot", str(body), "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}: the body\n"
    assert out.read_bytes().startswith(STARTS["png"])
    reader = DatasetReader(body)
    mesh, key = draw(DatasetBody(reader, reader.body)).axes
    assert [len(np.asarray(marks.get_offsets())) for marks in mesh.collections[1:]] == [4, 15]
    legend = key.get_legend()
    assert legend is not None
    assert legend.get_title().get_text().startswith("beam2d: body without samples\n64 ")
    assert main(["plot", str(body), "--out", str(out), "--samples", "1"]) == 2
    assert "is a body, which has no samples" in capsys.readouterr().err


def test_groups_of_a_case(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Cells of a group are faces of its colour, those of the inside too; nodes are marks."""
    (tmp_path / "own.geo").write_text(
        'SetFactory("OpenCASCADE"); Box(1) = {0, 0, 0, 3, 3, 3}; Box(2) = {1, 1, 1, 1, 1, 1};\n'
        "BooleanFragments{ Volume{1}; Delete; }{ Volume{2}; Delete; }\n"
        'Physical Volume("inner") = {2}; Physical Volume("outer") = {3};\n'
        'Physical Surface("low") = Surface In BoundingBox {-1, -1, -0.1, 4, 4, 0.1};\n'
        "Mesh.MeshSizeMax = 1;\n"
    )
    case = {**CASE, "mesh": {"kind": "file", "path": "own.geo"}, "supports": [{"z": 0}]}
    case["load"] = {"family": "body_force", "range": [-1, 1]}
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(case))
    out = tmp_path / "a.png"
    assert main(["plot", str(tmp_path / "own.yaml"), "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}: the body\n"
    assert main(["body", str(tmp_path / "own.yaml"), "--out", str(tmp_path / "body")]) == 0
    reader = DatasetReader(tmp_path / "body")
    dataset = DatasetBody(reader, reader.body)
    assert {name: bool(cells.any()) for name, (_, cells) in dataset.groups.items()} == {
        "inner": True,
        "low": False,
        "outer": True,
    }
    mesh, key = draw(dataset).axes
    white, outer, inner, low, *_ = mesh.collections
    assert len(inner.get_paths()) < len(outer.get_paths()) >= len(white.get_paths())
    assert len(np.asarray(low.get_offsets())) == dataset.groups["low"][0].sum()
    legend = key.get_legend()
    assert legend is not None
    named = [text.get_text() for text in legend.get_texts()]
    assert named == ["clamped node", "loadable node", "inner", "low", "outer"]


def test_resultant_and_moment() -> None:
    """A couple of 3 N at a distance of 0.2 m; with a third force, about the mean of the nodes."""
    x = np.array([[0.0, 0.1], [0.0, -0.1], [0.3, 0.0], [-0.3, 0.0]])
    force = np.array([[3.0, 0.0], [-3.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    np.testing.assert_allclose(resultant_of(force, x), (0.0, 0.6))
    force[2] = (0.0, 4.0)
    np.testing.assert_allclose(resultant_of(force, x), (4.0, abs(4.0 * 0.3 - 0.6)))
    space = np.pad(x, ((0, 0), (0, 1))), np.pad(force, ((0, 0), (0, 1)))
    assert resultant_of(space[1], space[0]) == resultant_of(force, x)
