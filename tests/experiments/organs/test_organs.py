"""The report on organs: its scales, its datasets and its studies, on a made-up body."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from experiments.framework.data_commands import missing_data
from experiments.framework.experiment import Findings
from experiments.framework.record import Table
from experiments.framework.resources import Resources
from experiments.framework.scale import DatasetSpec, Scale, read_scale
from experiments.organs import published_load
from experiments.organs.accuracy import HEAD
from experiments.organs.catalogue import ORGANS
from experiments.organs.predictors import KINDS, WITH_DIRECTIONS
from tests.experiments.paper.made_up import SAMPLES, results

LABELS = [*list(KINDS.values())[:1], WITH_DIRECTIONS, *list(KINDS.values())[1:]]


def test_rows_of_nodes_are_made_of_the_same_solutions(tmp_path: Path) -> None:
    commands = list(missing_data(read_scale("smoke", ORGANS.scales), tmp_path))
    nodal = tmp_path / "breast3d-24" / "nodal"
    assert sum("datagen run breast3d" in line for line in commands) == 1
    row = tmp_path / "breast3d-24-nodes" / "structured"
    assert f"datagen structure {nodal} --out {row} --grid nodes" in commands
    with pytest.raises(ValueError, match="grid: nodes"):
        DatasetSpec(case="breast3d", grid="nodes")


@pytest.fixture(scope="module")
def result_of(
    tmp_path_factory: pytest.TempPathFactory, make_dataset: Callable[..., Path]
) -> Callable[[str], Findings]:
    """Results of the studies on a made-up body in space."""
    content, folder = read_scale("smoke", ORGANS.scales).model_dump(), tmp_path_factory.mktemp("o")
    for name in content["datasets"]:
        content["datasets"][name] = {"case": "breast3d", "samples": SAMPLES}
    scale = Scale.model_validate(content | {"name": "made-up"})
    make_dataset(folder / "data" / scale.folder_of("breast3d"), 3, name="breast3d")
    return results(Resources(scale, folder / "data", folder / "runs", torch.device("cpu")))


def test_accuracy(result_of: Callable[[str], Findings]) -> None:
    """A row for each kind and one for directions; intervals of those that have some."""
    (table,) = result_of("organ-accuracy").tables
    by_label = labelled(table, 1)
    assert list(by_label) == LABELS
    covered = HEAD.index("in 95 % intervals [%]")
    for label, row in by_label.items():
        assert len(row) == len(HEAD)
        assert (row[covered] is not None) == (label in {KINDS["reduced-vb"], KINDS["modal-gp"]})
        assert row[4] <= row[5] <= row[6] <= 100  # shares of loads


def test_published_load(
    result_of: Callable[[str], Findings], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against a solution of the made-up body, here none: errors are the displacements."""
    file = tmp_path / "solution.txt"
    np.savetxt(file, np.zeros((128, 3)))
    monkeypatch.setattr(published_load, "ACEFEM", file)
    (table,) = result_of("organ-published").tables
    assert list(labelled(table, 0)) == [*LABELS, "graph U-Net of the authors, published"]
    assert table.rows[-1][1] == pytest.approx(28)
    assert all(float(str(row[1])) > 0 for row in table.rows)


def test_pictures(result_of: Callable[[str], Findings]) -> None:
    assert list(result_of("organ-pictures").figures) == ["breast3d"]


def labelled(table: Table, column: int) -> dict[str, tuple[Any, ...]]:
    """Rows of a table by the label in a column."""
    return {str(row[column]): row for row in table.rows}
