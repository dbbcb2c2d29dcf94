"""A dataset in the PLAID format: pyplaid's checker passes, and pyplaid reads the same numbers."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from datagen.command_line import main
from datagen.contrib.plaid import exporting
from datagen.transforms.reindexing import nodal_forces_of, structure
from shared_schema.common.errors import InputError
from shared_schema.dataset_reader import DatasetReader
from tests.datagen.refusal import refusal

READ_BACK = Path(__file__).with_name("read_back.py")


def exported(nodal: Path, out: Path, python: Path, *options: str) -> dict[str, np.ndarray]:
    """Export a dataset, check it, and read it by pyplaid."""
    words = ["export", str(nodal), "--format", "plaid", "--out", str(out), "--python", str(python)]
    assert main([*words, *options]) == 0
    checked = subprocess.run(
        [python.with_name("plaid-check"), out], capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stdout
    assert "0 error(s), 0 warning(s)" in checked.stdout
    subprocess.run([python, READ_BACK, out, out.parent / "read.npz"], check=True)
    with np.load(out.parent / "read.npz") as file:
        return dict(file)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("backend", "rounded"), [("hf_datasets", np.float32), ("cgns", np.float64)]
)
def test_reading_it_back_gives_the_same_numbers(
    nodal: Path, tmp_path: Path, plaid: Path, backend: str, rounded: type
) -> None:
    """Bit for bit; Hugging Face's storage keeps fields of a sample in float32."""
    found = exported(nodal, tmp_path / "plaid", plaid, "--backend", backend)
    structured = DatasetReader(_structured(nodal, tmp_path), "structured")
    splits = structured.joined(("samples/number", "samples/is_test"))
    is_test, numbers = splits["samples/is_test"], splits["samples/number"]
    arrays: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    for _, shard in DatasetReader(nodal, "nodal"):
        fields = zip(nodal_forces_of(shard), shard["samples/displacement"], strict=True)
        arrays |= dict(zip(shard["samples/number"].tolist(), fields, strict=True))
    body = structured.body
    for split, chosen in (("train", ~is_test), ("test", is_test)):
        np.testing.assert_array_equal(found[f"{split}/number"].ravel(), numbers[chosen])
        force, displacement = (
            np.array([arrays[number][field] for number in numbers[chosen]]) for field in (0, 1)
        )
        for field, expected in (("force", force), ("displacement", displacement)):
            for axis, values in zip("xy", np.moveaxis(expected, -1, 0), strict=True):
                read = found[f"{split}/{field}_{axis}"]
                np.testing.assert_array_equal(read, values.astype(rounded))
        for coordinates in found[f"{split}/coordinates"]:
            np.testing.assert_allclose(coordinates, body["mesh/coordinates"], rtol=1e-7)
        np.testing.assert_array_equal(found[f"{split}/QUAD_4"], body["mesh/cells"])
        for tag in ("clamped", "loadable"):
            nodes = np.flatnonzero(body[f"mesh/{tag}"])
            np.testing.assert_array_equal(found[f"{split}/{tag}"], nodes)


def _structured(nodal: Path, folder: Path) -> Path:
    structure(nodal, folder / "structured")
    return folder / "structured"


@pytest.mark.slow
def test_what_is_known_about_it(nodal: Path, tmp_path: Path, plaid: Path) -> None:
    out = tmp_path / "plaid"
    exported(nodal, out, plaid, "--owner", "We", "--license", "CC-BY-4.0")
    infos = yaml.safe_load((out / "infos.yaml").read_text())
    assert (infos["owner"], infos["license"]) == ("We", "CC-BY-4.0")
    assert infos["num_samples"] == {"train": 28, "test": 2}  # round(0.05 · 30) of them
    assert "dolfinx" in infos["data_production"]["simulator"]
    problem = yaml.safe_load((out / "problem_definitions" / "displacement.yaml").read_text())
    fields = "Base_2_2/Zone/VertexFields/"
    assert problem["input_features"] == [f"{fields}force_{axis}" for axis in "xy"]
    assert problem["output_features"] == [f"{fields}displacement_{axis}" for axis in "xy"]
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_what_has_no_field_is_refused(
    nodal: Path, tmp_path: Path, plaid: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rollers, several materials and pressures would be lost without a word."""
    names = "held", "material", "fibres", "pressed"
    assert tuple(f"mesh/{name}" for name in names) == exporting.NOT_CARRIED
    monkeypatch.setattr(exporting, "NOT_CARRIED", ("mesh/pressed", "mesh/clamped"))
    with pytest.raises(InputError, match=r"has 'mesh/clamped', expected a dataset of one material"):
        exporting.export_plaid(nodal, tmp_path / "plaid", python=plaid)
    assert list(tmp_path.iterdir()) == []


def test_refusals(nodal: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing is written."""
    there = tmp_path / "there"
    there.mkdir()
    words = ["export", str(nodal), "--format", "plaid", "--out"]
    out = [*words, str(tmp_path / "plaid")]
    for arguments, part in (
        ([*words, str(there)], "exists, expected a new folder"),
        ([*words, str(there / "a" / "b")], f"no such folder {there / 'a'}"),
        ([*out, "--python", "/nowhere/python"], "--python '/nowhere/python': cannot be run"),
        ([*out, "--python", sys.executable], "has no pyplaid; `python3 -m venv plaid"),
        (out, "--python: pyplaid is not installed here"),
        ([*out, "--samples", "0:3"], "--samples 0:3: expected none with --format plaid"),
        (["export", str(nodal), "--out", "a.pvd", "--owner", "We"], "--owner We: expected with"),
    ):
        assert part in refusal(arguments, capsys)
    assert list(tmp_path.iterdir()) == [there]
