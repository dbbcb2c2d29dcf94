"""The script of the page "From Python", run with both programs."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.documentation.page import blocks_of
from tests.end_to_end.commands import DATAGEN, ENVIRONMENT, ROOT

PAGE = ROOT / "docs" / "tutorials" / "python.md"
SCRIPT = PAGE.with_name("ten_lines.py")
EXACT = """
import numpy as np
exact = datagen.solve("beam2d", "4,1:0,-1.5").displacement
true, estimated = exact - solution.displacement, solution.estimated_error
print(np.linalg.norm(exact, axis=1).max(), np.abs(true).mean(), np.abs(estimated).mean())
"""


def test_it_is_the_block_of_the_page() -> None:
    block = next(iter(blocks_of(PAGE))).parsed
    assert block.source == SCRIPT.read_text()
    assert sum(bool(line) for line in SCRIPT.read_text().splitlines()) == 10


def test_ten_lines(tmp_path: Path) -> None:
    """The certificate's error is that against the finite elements of `datagen`, to 1 %.

    The corner's displacement of 631 mm on the page is that of the finite elements, too.
    """
    text = SCRIPT.read_text().replace("samples=200", "samples=20")
    assert "samples=20)" in text
    (tmp_path / "script.py").write_text(text + EXACT)
    runner = ROOT / "tools" / "both_programs.py"
    command: list[str | Path] = [DATAGEN.parent / "python", runner, "script.py"]
    result = subprocess.run(
        command, cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    *_, numbers = result.stdout.splitlines()
    corner, true, estimated = map(float, numbers.split())
    assert corner == pytest.approx(0.631, abs=5e-4)
    assert estimated == pytest.approx(true, rel=0.01)
    assert "largest displacement: 631 mm at (4, 1) m" in result.stdout
    assert (tmp_path / "solution.png").stat().st_size > 0
