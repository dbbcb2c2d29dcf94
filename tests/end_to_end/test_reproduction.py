"""All studies of both reports at scale `smoke`: a first run, a second run, and one after a loss."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.end_to_end.commands import ROOT, execute


@pytest.mark.studies
@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("target", "least"),
    [("reproduce", 17), ("beyond", 7)],  # tables and figures of the paper with results; wanted
)
def test_smoke(tmp_path: Path, target: str, least: int) -> None:
    where = f"--data {tmp_path / 'data'} --runs {tmp_path / 'runs'} --out {tmp_path / 'out'}"
    make = ("make", "-C", ROOT, target, "SCALE=smoke", f"WHERE={where}")
    execute(*make)
    page = (tmp_path / "out" / "README.md").read_text()
    records = sorted((tmp_path / "out").glob("*.json"))
    assert len(records) >= least
    assert "not done" not in page
    for record in records:
        found = json.loads(record.read_text())["findings"]
        assert found["tables"] or found["captions"], record.name
        for figure in found["captions"]:
            assert (tmp_path / "out" / figure).read_bytes().startswith(b"\x89PNG"), figure
            assert f"({figure})" in page
    again = execute(*make)
    assert f"{len(records)} of {len(records)} studies up to date" in again.stdout
    assert "done now" not in again.stdout
    records[0].unlink()
    assert "1 done now" in execute(*make).stdout
