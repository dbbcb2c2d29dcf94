"""The examples of the how-to pages for the factory give what they describe."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from datagen.cases.case import SHIPPED
from datagen.command_line import main
from shared_schema.shard import read_shard

pytestmark = pytest.mark.docs

HOW_TO = Path(__file__).parents[2] / "docs" / "how-to"


def block(page: str, title: str) -> str:
    """Code block of a page that has a given title."""
    text = (HOW_TO / page).read_text()
    found = re.search(rf'```\w+ title="{re.escape(title)}"\n(.*?)```', text, re.DOTALL)
    assert found is not None, title
    return found[1]


def test_load_family_of_a_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same push of at most 0.5 N per component acts on every node of the free end."""
    (tmp_path / "push.py").write_text(block("loads.md", "push.py"))
    case = yaml.safe_load((SHIPPED / "beam2d.yaml").read_text())
    case |= yaml.safe_load(block("loads.md", "push.yaml"))
    (tmp_path / "push.yaml").write_text(yaml.safe_dump(case))
    monkeypatch.chdir(tmp_path)
    assert main(["run", "push.yaml", "--samples", "5", "--out", "nodal"]) == 0
    shard = read_shard(tmp_path / "nodal" / "shard-00000.h5", "nodal")
    assert shard["samples/loaded_nodes"].shape == (5, 4)
    assert np.ptp(shard["samples/force"], axis=1).max() == 0
    assert 0 < np.abs(shard["samples/force"]).max() <= 0.5


def test_mesh_of_a_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The loadable nodes are the 7 of the free edge, 1.6 m in 10 element edges, above 0.5 m."""
    (tmp_path / "plate2d.yaml").write_text(block("mesh.md", "plate2d.yaml"))
    script = SHIPPED / "plate_with_holes.geo"
    (tmp_path / script.name).write_bytes(script.read_bytes())
    monkeypatch.chdir(tmp_path)
    assert main(["run", "plate2d.yaml", "--samples", "5", "--out", "nodal"]) == 0
    shard = read_shard(tmp_path / "nodal" / "shard-00000.h5", "nodal")
    loadable = shard["mesh/coordinates"][shard["mesh/loadable"]]
    assert np.sort(loadable[:, 1]) == pytest.approx(0.16 * np.arange(4, 11))
    assert loadable[:, 0] == pytest.approx(4.0)
