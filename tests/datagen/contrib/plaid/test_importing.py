"""Nodal datasets of PLAID datasets: our own, and those of others."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from datagen.command_line import main
from datagen.contrib.plaid.exporting import export_plaid
from datagen.contrib.plaid.importing import import_plaid
from datagen.transforms.reindexing import structure
from shared_schema.checker import check_dataset
from shared_schema.common.errors import InputError
from shared_schema.dataset_reader import DatasetReader
from shared_schema.manifest import read_manifest
from tests.datagen.refusal import refusal

FOREIGN = Path(__file__).with_name("make_foreign.py")
FIELDS = ["--inputs", "fx,fy", "--outputs", "ux,uy"]
MATERIAL = ["--set", "material={young_modulus: 500, poisson_ratio: 0.4}"]


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory, plaid: Path) -> Path:
    folder = tmp_path_factory.mktemp("foreign") / "theirs"
    subprocess.run([plaid, FOREIGN, folder], check=True, capture_output=True)
    return folder


@pytest.mark.slow
def test_there_and_back_is_the_same_dataset(nodal: Path, tmp_path: Path, plaid: Path) -> None:
    """Bit for bit with CGNS, and with the same split; only what a solver says is lost."""
    export_plaid(nodal, tmp_path / "plaid", backend="cgns", python=plaid)
    back = tmp_path / "nodal"
    import_plaid(tmp_path / "plaid", back, python=plaid)
    assert check_dataset(back) == []
    names = [f"samples/{name}" for name in ("number", "loaded_nodes", "force", "displacement")]
    ours, theirs = (DatasetReader(folder, "nodal") for folder in (nodal, back))
    assert theirs.manifest.case == ours.manifest.case
    for name, values in ours.body.items():
        np.testing.assert_array_equal(theirs.body[name], values)
    found = theirs.joined(names)
    for name, values in ours.joined(names).items():
        np.testing.assert_array_equal(found[name], values)
    one, other = structure(nodal, tmp_path / "one"), structure(back, tmp_path / "other")
    assert one.structured is not None
    assert other.structured is not None
    assert other.structured.displacement == one.structured.displacement
    first, second = (
        DatasetReader(tmp_path / name, "structured").joined(["samples/is_test"])["samples/is_test"]
        for name in ("one", "other")
    )
    np.testing.assert_array_equal(first, second)


def test_a_dataset_of_somebody_else(foreign: Path, tmp_path: Path, plaid: Path) -> None:
    """Plane although in space; clamped where nothing moves, loadable where a force acts."""
    out = tmp_path / "nodal"
    words = ["import", str(foreign), "--out", str(out), "--python", str(plaid)]
    assert main([*words, *FIELDS, *MATERIAL]) == 0
    assert check_dataset(out) == []
    reader = DatasetReader(out, "nodal")
    assert (reader.cell_type, reader.manifest.samples, reader.manifest.dimension) == (
        "triangle",
        5,
        2,
    )
    body = reader.body
    assert body["mesh/clamped"].tolist() == [True, True, False, False]
    assert body["mesh/loadable"].tolist() == [False, False, True, True]
    arrays = reader.joined(["samples/force", "samples/displacement"])
    np.testing.assert_allclose(arrays["samples/force"][2], [[1.5, 0], [-0.75, 0]])
    np.testing.assert_allclose(arrays["samples/displacement"][2, 2], [3.0, 0.15])
    assert reader.manifest.transforms[0]["owner"] == "They"
    made = structure(out, tmp_path / "structured").structured
    assert made is not None
    assert (made.train, made.test) == (3, 2)
    tested = DatasetReader(tmp_path / "structured", "structured").joined(["samples/is_test"])
    assert tested["samples/is_test"].tolist() == [False, False, False, True, True]


@pytest.mark.slow
def test_refusals(
    foreign: Path, tmp_path: Path, plaid: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    several = tmp_path / "several"
    subprocess.run([plaid, FOREIGN, several, "several"], check=True, capture_output=True)
    out = tmp_path / "nodal"
    python = ["--out", str(out), "--python", str(plaid)]
    for source, options, part in (
        (foreign, MATERIAL, "no field force_x at the nodes, found fx, fy, ux, uy"),
        (foreign, ["--inputs", "fx", *MATERIAL], "1 components of the force, expected 2"),
        (foreign, FIELDS, "its description names no material, expected --set"),
        (several, [*FIELDS, *MATERIAL], "sample 1 of train has another mesh"),
        (tmp_path, FIELDS, "no infos.yaml in it, expected a PLAID dataset"),
    ):
        assert part in refusal(["import", str(source), *python, *options], capsys)
        assert not out.exists()
    assert "a dataset in the PLAID format; `datagen import`" in refusal(
        ["check", str(foreign)], capsys
    )


def test_a_wrong_split_is_refused(nodal: Path, tmp_path: Path) -> None:
    """A manifest of somebody else may say anything."""
    manifest = read_manifest(nodal)
    splits: tuple[object, ...] = ("all", [30], [-1], [[]], None)
    for rows in splits:
        step = {"name": "import", "test": rows}
        wrong = manifest.model_copy(update={"transforms": (step,)}).sealed()
        folder = tmp_path / "nodal"
        folder.mkdir(exist_ok=True)
        for path in nodal.iterdir():
            (folder / path.name).write_bytes(path.read_bytes())
        (folder / "manifest.json").write_text(wrong.spelled())
        with pytest.raises(InputError, match="the test split of its import is none of it"):
            structure(folder, tmp_path / "structured")
