"""All studies of both reports at scale `smoke`: a first run, a second run, and one after a loss."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch

from experiments.__main__ import main
from experiments.framework.record import Table
from experiments.measures.alarms import KINDS
from experiments.measures.corrections import LINEAR, PREDICTION, ZERO
from surrogate.learning.runs.config_reader import read_recipe
from tests.end_to_end.commands import ROOT, execute


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the datasets of the reports, which have some in common."""
    return tmp_path_factory.mktemp("data")


@pytest.mark.studies
@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("target", "title", "least"),  # tables and figures of the paper with results; wanted
    [
        ("reproduce", "The paper's tables and figures", 17),
        ("beyond", "Beyond the paper", 7),
        ("organs", "Organs", 3),
    ],
)
def test_smoke(
    tmp_path: Path,
    data: Path,
    capsys: pytest.CaptureFixture[str],
    target: str,
    title: str,
    least: int,
) -> None:
    """By `make` at first; then by the commands of its recipe, which find all datasets."""
    where = ("--data", str(data), "--runs", str(tmp_path / "runs"), "--out", str(tmp_path / "out"))
    execute("make", "-C", ROOT, target, "SCALE=smoke", "NP=1", f"WHERE={' '.join(where)}")
    page = (tmp_path / "out" / "README.md").read_text()
    records = sorted((tmp_path / "out").glob("*.json"))
    assert len(records) >= least
    assert page.startswith(f"# {title}, at scale `smoke`")
    assert "not done" not in page
    assert ("verdict" in page) == ("in the paper" in page) == (target == "reproduce")
    for record in records:
        content = json.loads(record.read_text())
        check_origin(content)
        found = content["findings"]
        assert found["tables"] or found["captions"], record.name
        for figure in found["captions"]:
            assert (tmp_path / "out" / figure).read_bytes().startswith(b"\x89PNG"), figure
            assert f"({figure})" in page
    if target == "beyond":
        check_certificates(tmp_path / "out" / "certificates.json")
    again = (target, "--scale", "smoke", *where)
    assert main([*again, "--list-data"]) == 0
    assert capsys.readouterr().out == ""
    assert main(again) == 0
    said = capsys.readouterr().out
    assert f"{len(records)} of {len(records)} studies up to date" in said
    assert "done now" not in said
    records[-1].unlink()
    assert main(again) == 0
    assert "1 done now" in capsys.readouterr().out


def check_origin(record: dict[str, Any]) -> None:
    """Check that a record holds configuration, seeds, software and digests."""
    assert len(record["digest"]) == len(record["inputs"]) == 64
    assert record["software"]["torch"] == torch.__version__
    assert record["configuration"] == {"scale": "smoke", "passes": 4}
    for network in record["runs"].values():
        assert read_recipe(network["config"])
        assert network["seed"] == 0
        assert len(network["fingerprint"]) == 64


def check_certificates(path: Path) -> None:
    """Check that every network has its rows, in the plane and in space."""
    record = json.loads(path.read_text())
    tables = [Table.model_validate(table) for table in record["findings"]["tables"]]
    estimates, corrections, _, single, several, wrong, starts = tables
    assert {"beam2d-forces-ensemble", "beam2d_any-mechanics", "beam3d_any-reduced"} < set(
        record["runs"]
    )
    assert len(estimates.rows) == len(corrections.rows) == len(record["runs"])
    alarms = {str(row[1]) for row in (*single.rows, *several.rows)}
    assert {"estimated error over displacement", "predicted σ"} < alarms
    assert single.head[2:] == KINDS
    areas = [cell for row in single.rows for cell in row[2:] if cell is not None]
    assert all(0 <= float(area) <= 1 for area in areas)
    assert all(len(row) == 4 for row in wrong.rows)
    assert [row[1] for row in starts.rows[:3]] == [ZERO, LINEAR, PREDICTION]
    assert not any(row[-1] for row in starts.rows)
    assert "certificates-estimates.png" in record["findings"]["captions"]
