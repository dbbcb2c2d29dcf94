"""The report beyond the paper: its scales, its studies, and one run of all of them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from experiments.beyond import force_sizes
from experiments.beyond.catalogue import BEYOND
from experiments.beyond.networks import KINDS, kind_of, runs_by_body
from experiments.framework.resources import Resources
from experiments.framework.run_report import find_report, find_studies, reproduce
from experiments.framework.scale import Scale, read_scale
from experiments.framework.studies_report import PAGE
from experiments.framework.study_record import Claim
from shared_schema.common.errors import InputError
from surrogate.runs.recipes import read_recipe


@pytest.mark.parametrize("name", ["smoke", "plane", "space", "laptop", "day"])
def test_runs_of_the_shipped_scales(name: str) -> None:
    """Every run has a configuration and a kind, and is needed by a study."""
    scale = read_scale(name, BEYOND.scales)
    used = {run for study in BEYOND.studies for run in scale.matching(study.runs)}
    assert used == set(scale.runs)
    for run in scale.runs:
        assert scale.config_of(run).case == scale.case_of(scale.runs[run].data)
        assert kind_of(run) in KINDS.values()


def test_series_of_a_day() -> None:
    """250 to 8000 samples in the plane, 250 to 4000 in space, with as many steps each."""
    scale = read_scale("day", BEYOND.scales)
    assert scale.config_of("beam2d_any-forces-n250").training.samples == 250
    steps = []
    for count in (250, 8000):
        training = scale.config_of(f"beam2d_any-mechanics-n{count}").training
        steps.append(training.model_dump()["epochs"] * count)
    assert steps == [320_000, 320_000]
    assert "beam2d_any-forces-n8000" in scale.runs
    assert "beam3d_any-reduced-n4000" in scale.runs
    assert "beam3d_any-reduced-n8000" not in scale.runs


def test_forces_in_and_mechanics_differ_by_the_mechanics_alone() -> None:
    """And by size and epochs: mechanics need less; and by the samples kept for bounds."""
    scale = read_scale("day", BEYOND.scales)
    for case in ("beam2d_any", "lshape2d_any", "beam3d_any"):
        forces, mechanics = (
            scale.unet_of(f"{case}-{kind}").plain() for kind in ("forces", "mechanics")
        )
        inputs = ["force", "linear_gradient", "last_gradient"]
        assert mechanics["network"].pop("inputs") == inputs
        assert mechanics["network"].pop("skip") == "series"
        assert mechanics["network"]["channels"] < forces["network"]["channels"]
        size = ("levels", "channels", "multiplier", "padding")
        for key in ("inputs", "skip", "series_order", *size):
            del forces["network"][key]
            mechanics["network"].pop(key, None)
        assert mechanics["training"].pop("epochs") <= forces["training"].pop("epochs")
        assert forces["training"].pop("calibration_fraction") == 0.02
        assert mechanics["training"].pop("calibration_fraction") == 0.1
        assert forces | {"name": ""} == mechanics | {"name": ""}


def test_a_series_without_samples_is_refused() -> None:
    content = read_scale("smoke", BEYOND.scales).model_dump()
    content["series"] = {"beam2d-forces": {"config": "beam2d-det-fast", "data": "beam2d"}}
    with pytest.raises(ValueError, match="samples"):
        Scale.model_validate(content)


def test_bodies_without_a_network_are_left_out(resources: Resources) -> None:
    found = runs_by_body(resources.scale, ("forces", "reduced"))
    assert found == {
        "beam2d_any": ["beam2d_any-forces", "beam2d_any-reduced"],
        "beam3d_any": ["beam3d_any-reduced"],
    }


def test_studies_of_two_reports_are_refused() -> None:
    assert find_report(["places"]) is BEYOND
    assert [study.name for study in find_studies(["places", "coverage"])] == ["places", "coverage"]
    with pytest.raises(InputError, match="study 'datasets': expected one of the report of 'place"):
        find_studies(["places", "datasets"])


@pytest.mark.parametrize(("holds", "verdict"), [(True, "holds"), (False, "fails")])
def test_verdicts_beyond_the_paper(holds: bool, verdict: str) -> None:
    claim = Claim(what="It holds.", holds=holds, evidence="1 < 2", of_paper=False)
    assert claim.verdict == verdict


def test_the_whole_report(resources: Resources, tmp_path: Path) -> None:
    """Records hold configuration, seed and digests; the page has every study and figure."""
    count = len(BEYOND.studies)
    assert reproduce(BEYOND.studies, resources, tmp_path, of=BEYOND) == count
    assert reproduce(BEYOND.studies, resources, tmp_path, of=BEYOND) == 0
    page = (tmp_path / PAGE).read_text()
    assert page.startswith("# Beyond the paper, at scale `made-up`")
    assert "In the paper" not in page
    assert "not done" not in page
    for study in BEYOND.studies:
        record = json.loads((tmp_path / f"{study.name}.json").read_text())
        assert record["findings"]["tables"], study.name
        for run in record["runs"].values():
            assert read_recipe(run["config"])
            assert run["seed"] == 0
            assert len(run["fingerprint"]) == 64
        for figure in record["findings"]["captions"]:
            assert f"({figure})" in page


def test_a_missing_dataset_is_named(resources: Resources, tmp_path: Path) -> None:
    empty = Resources(resources.scale, tmp_path / "none", resources.runs, torch.device("cpu"))
    with pytest.raises(InputError, match="none/beam2d_many-60/nodal"):
        reproduce(BEYOND.studies, empty, tmp_path / "out", of=BEYOND)
    assert not (tmp_path / "out").exists()


def test_a_scale_without_the_datasets_of_a_study(resources: Resources, tmp_path: Path) -> None:
    """Its section says so, without an empty table or figure."""
    kept = {k: v for k, v in resources.scale.datasets.items() if not k.endswith("_sweep")}
    scale = resources.scale.model_copy(update={"datasets": kept})
    without = Resources(scale, resources.data, resources.runs, torch.device("cpu"))
    reproduce([force_sizes.STUDY], without, tmp_path, of=BEYOND)
    page = (tmp_path / PAGE).read_text()
    section = page.partition(f"## {force_sizes.STUDY.title}")[2].partition("\n## ")[0]
    assert "This scale has no dataset for it." in section
    assert "|" not in section
    assert not list(tmp_path.glob("force-sizes*.png"))
