"""The example of the README reads a dataset with h5py and NumPy alone."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import shared_schema
from shared_schema.common.bodies.nodal_forces import scatter_forces
from shared_schema.dataset_reader import DatasetReader

pytestmark = pytest.mark.docs

README = Path(shared_schema.__file__).parent / "README.md"


def example() -> str:
    section = README.read_text().partition("## Without this project's code")[2]
    found = re.search(r"```python\n(.*?)```", section, re.S)
    assert found is not None
    return found[1]


def test_it_is_twenty_lines_of_h5py_and_numpy() -> None:
    code = example()
    imports = {
        alias.name if isinstance(node, ast.Import) else str(node.module)
        for node in ast.walk(ast.parse(code))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    }
    assert imports == {"json", "pathlib", "h5py", "numpy"}
    assert len([line for line in code.splitlines() if line.strip()]) <= 20


def test_it_reads_the_same_numbers(
    nodal: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "data" / "beam2d").mkdir(parents=True)
    (tmp_path / "data" / "beam2d" / "nodal").symlink_to(nodal)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(example(), names)
    reader = DatasetReader(nodal, "nodal")
    prefix = "samples/"
    arrays = reader.joined([prefix + name for name in ("loaded_nodes", "force", "displacement")])
    nodes = len(reader.body["mesh/coordinates"])
    expected = scatter_forces(arrays["samples/loaded_nodes"], arrays["samples/force"], nodes)
    np.testing.assert_array_equal(names["force"], expected)
    np.testing.assert_array_equal(names["displacement"], arrays["samples/displacement"])
    np.testing.assert_array_equal(names["cells"], reader.body["mesh/cells"])
    assert expected.any()
