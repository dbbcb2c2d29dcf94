"""All studies at scale `smoke`, from nothing to the report; and again after a record is lost."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.end_to_end.commands import ROOT, execute


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_smoke(tmp_path: Path) -> None:
    where = f"--data {tmp_path / 'data'} --runs {tmp_path / 'runs'} --out {tmp_path / 'out'}"
    make = ("make", "-C", ROOT, "reproduce", "SCALE=smoke", f"WHERE={where}")
    execute(*make)
    page = (tmp_path / "out" / "README.md").read_text()
    records = sorted((tmp_path / "out").glob("*.json"))
    assert len(records) >= 17  # as many as the paper's tables and figures of results
    assert "not done" not in page
    for record in records:
        found = json.loads(record.read_text())["findings"]
        assert found["tables"] or found["captions"], record.name
        for figure in found["captions"]:
            assert (tmp_path / "out" / figure).read_bytes().startswith(b"\x89PNG"), figure
            assert f"({figure})" in page
    records[0].unlink()
    again = execute(*make)
    others = len(records) - 1
    assert f"1 done now, {others} of {len(records)} studies up to date" in again.stdout
