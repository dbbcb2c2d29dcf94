"""The notebook of the tutorials, executed."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from tests.end_to_end.commands import ROOT

NOTEBOOK = ROOT / "docs" / "tutorials" / "notebook.ipynb"


def stored() -> Any:
    """Return the notebook; nbformat has no types."""
    return nbformat.read(NOTEBOOK, as_version=4)


@pytest.mark.slow
def test_notebook(tmp_path: Path) -> None:
    """Every cell runs, and the certificate's estimate is the true mean error to 1 %."""
    notebook = stored()
    NotebookClient(notebook, timeout=120, resources={"metadata": {"path": tmp_path}}).execute()
    outputs = [out for cell in notebook.cells for out in cell.get("outputs", [])]
    text = "".join(out.get("text", "") for out in outputs)
    found = re.search(r"true mean error (\S+) mm, estimated (\S+) mm", text)
    assert found is not None
    assert float(found[2]) == pytest.approx(float(found[1]), rel=0.01)
    assert sum("image/png" in out.get("data", {}) for out in outputs) == 2


def test_stored_outputs_are_those_of_all_cells() -> None:
    """The notebook is stored as executed, so that it can be read without running it."""
    cells = [cell for cell in stored().cells if cell.source]
    counts = [cell.execution_count for cell in cells if cell.cell_type == "code"]
    assert counts == list(range(1, len(counts) + 1))
