"""The report beyond the paper: its scales and its studies."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from experiments.beyond import force_sizes
from experiments.beyond.catalogue import BEYOND
from experiments.beyond.networks import KINDS, kind_of
from experiments.framework.data_commands import missing_data
from experiments.framework.report import PAGE, write_current
from experiments.framework.resources import Resources
from experiments.framework.runner import run
from experiments.framework.scale import DatasetSpec, Scale, read_scale
from shared_schema.common.errors import InputError

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("scale_name", ["smoke", "plane", "space", "laptop", "day"])
def test_runs_of_the_shipped_scales(scale_name: str) -> None:
    """Every run has a configuration and a kind, and is needed by a study."""
    scale = read_scale(scale_name, BEYOND.scales)
    used = {name for study in BEYOND.studies for name in scale.matching(study.runs)}
    assert used == set(scale.runs)
    for name in scale.runs:
        assert scale.config_of(name).case == scale.case_of(scale.runs[name].data)
        assert kind_of(name) in KINDS.values()


def test_a_series_without_samples_is_refused() -> None:
    content = read_scale("smoke", BEYOND.scales).model_dump()
    content["series"] = {"beam2d-forces": {"config": "beam2d-det-fast", "data": "beam2d"}}
    with pytest.raises(ValueError, match="samples"):
        Scale.model_validate(content)


def test_a_dataset_of_a_changed_case(tmp_path: Path) -> None:
    """Its folder is not that of the case; only a case is changed, no dataset made of another."""
    mesh = {"mesh.elements": [11, 3, 3]}
    spec = DatasetSpec(case="beam3d_any", samples=40, grid=False, change=mesh)
    scale = Scale(name="s", description="", datasets={"a": spec}, runs={})
    folder = scale.folder_of("a")
    assert folder.startswith("beam3d_any-40-")
    _, line = missing_data(scale, tmp_path)
    assert "datagen run beam3d_any '--set=mesh.elements=[11, 3, 3]' --out" in line
    assert f"{folder}/nodal --samples 40" in line
    with pytest.raises(ValueError, match="'change' changes a 'case'"):
        DatasetSpec(of="a", noise=True, change=mesh)


def test_a_missing_dataset_is_named(resources: Resources, tmp_path: Path) -> None:
    empty = Resources(resources.scale, tmp_path / "none", resources.runs, torch.device("cpu"))
    with pytest.raises(InputError, match="none/beam2d_many-60/nodal"):
        run(BEYOND.studies, empty, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_scale_without_the_datasets_of_a_study(resources: Resources, tmp_path: Path) -> None:
    """It counts as not done, without a section or a figure."""
    kept = {k: v for k, v in resources.scale.datasets.items() if not k.endswith("_sweep")}
    scale = resources.scale.model_copy(update={"datasets": kept})
    without = Resources(scale, resources.data, resources.runs, torch.device("cpu"))
    run([force_sizes.STUDY], without, tmp_path)
    write_current(BEYOND, without, tmp_path)
    page = (tmp_path / PAGE).read_text()
    assert f"## {force_sizes.STUDY.title}" not in page
    assert force_sizes.STUDY.title in page.partition("Not done: ")[2].splitlines()[0]
    assert not list(tmp_path.glob("force-sizes*.png"))
