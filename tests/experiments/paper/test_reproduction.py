"""Studies run once, and again only if their inputs or their files have changed."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest
import torch

from experiments.catalogue import REPORTS, find_studies
from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import (
    Claim,
    Verdict,
    compare,
)
from experiments.framework.report import PAGE, write_current, write_report
from experiments.framework.resources import Resources
from experiments.framework.runner import current_record, run
from experiments.framework.scale import merged, read_scale
from experiments.paper.catalogue import REPRODUCTION, STUDIES
from experiments.paper.published_numbers import PAPER
from shared_schema.common.drawing.figure_style import make_figure
from shared_schema.common.errors import InputError

ROOT = Path(__file__).parents[3]


def make_studies(calls: list[str]) -> list[Experiment[Resources]]:
    """Two studies that record their calls, one on a dataset and one on a network."""

    def measure(name: str) -> Findings:
        calls.append(name)
        claim = Claim(what="It holds.", holds=True, evidence="1 < 2")
        return Findings(claims=[claim], figures={"a": (make_figure(1, 1), "Nothing.")})

    labels, question = ("tab:datasets",), "Does it?"
    return [
        Experiment("one", "One", question, lambda _: measure("one"), labels, datasets=("beam2d",)),
        Experiment("two", "Two", question, lambda _: measure("two"), labels, runs=("beam2d-d*",)),
    ]


def test_another_network_makes_its_studies_again(resources: Resources, tmp_path: Path) -> None:
    calls: list[str] = []
    studies = make_studies(calls)
    run(studies, resources, tmp_path)
    change = {"runs": {"beam2d-det": {"change": {"seed": 1}}}}
    other = type(resources.scale).model_validate(merged(resources.scale.model_dump(), change))
    changed = Resources(other, resources.data, resources.runs, torch.device("cpu"))
    assert current_record(studies[0], changed, tmp_path) is not None
    assert current_record(studies[1], changed, tmp_path) is None
    run(studies, changed, tmp_path)
    assert calls == ["one", "two", "two"]


def test_a_network_is_trained_once(resources: Resources, tmp_path: Path) -> None:
    trained = resources.trained("beam2d-det")
    written = trained.model.stat().st_mtime_ns
    fresh = Resources(resources.scale, resources.data, resources.runs, torch.device("cpu"))
    assert fresh.trained("beam2d-det").folder == trained.folder
    assert trained.model.stat().st_mtime_ns == written


def test_a_missing_dataset_is_named_before_any_work(resources: Resources, tmp_path: Path) -> None:
    calls: list[str] = []
    empty = Resources(resources.scale, tmp_path / "none", resources.runs, torch.device("cpu"))
    with pytest.raises(InputError, match=r"none/beam2d-60/structured"):
        run(make_studies(calls), empty, tmp_path / "out")
    assert calls == []
    assert not (tmp_path / "out").exists()


def test_a_grid_of_other_samples_is_named(resources: Resources, tmp_path: Path) -> None:
    """The structured dataset has other forces than the nodal dataset beside it."""
    for kind, name in (("structured", "beam2d"), ("nodal", "beam2d_f1")):
        source = resources.data / resources.scale.folder_of(name) / kind
        shutil.copytree(source, tmp_path / resources.scale.folder_of("beam2d") / kind)
    mixed = Resources(resources.scale, tmp_path, resources.runs, torch.device("cpu"))
    with pytest.raises(InputError, match=r"structured: made of samples with digest"):
        mixed.manifest("beam2d")


def test_the_report_has_verdicts_numbers_and_figures(resources: Resources, tmp_path: Path) -> None:
    report, studies = find_studies(["deterministic-accuracy"])
    run(studies, resources, tmp_path, after=lambda: write_current(report, resources, tmp_path))
    text = (tmp_path / PAGE).read_text()
    assert "[Accuracy of deterministic U-Nets](#accuracy-of-deterministic-u-nets)" in text
    assert "| 2D beam (D): ē [mm] |" in text
    assert "| Order of the nodes | Table 3, Figure 6 | not done |" in text
    assert "| U-Net, 3 levels, c = 2, doubling, SiLU | absolute error | " in text


def test_a_scale_without_verdicts_prints_none(resources: Resources, tmp_path: Path) -> None:
    """The smallest scale shows that studies run; their numbers say nothing about the paper."""
    scale = read_scale("smoke", REPRODUCTION.scales)
    better = compare("ē", "mm", 0.1, 0.3)
    claims = [Claim(what="It holds.", holds=holds, evidence="1 < 2") for holds in (True, False)]
    findings = Findings(comparisons=[better], claims=claims)
    study: Experiment[Resources] = Experiment(
        "one", "One", "Does it?", lambda _: findings, ("tab:datasets",)
    )
    run([study], resources, tmp_path)
    report = replace(REPRODUCTION, studies=(study,))
    pages = {}
    for verdicts in (True, False):
        records = {"one": current_record(study, resources, tmp_path)}
        write_report(report, scale.model_copy(update={"verdicts": verdicts}), records, tmp_path)
        pages[verdicts] = (tmp_path / PAGE).read_text()
    assert not scale.verdicts
    assert not any(f"**{verdict}" in pages[False] for verdict in get_args(Verdict))
    assert pages[False].count("not at this scale") == 4  # summary, number, two statements
    assert "| 1 better · 1 reproduced · 1 differs |" in pages[True]
    assert "not at this scale" not in pages[True]


@pytest.mark.parametrize(
    ("report", "scale"),
    [
        ("reproduce", "laptop"),
        ("beyond", "plane"),
        ("beyond", "space"),
        ("organs", "laptop"),
        ("organs", "touch"),
    ],
)
def test_committed_reports_are_those_of_the_committed_records(
    report: str, scale: str, tmp_path: Path
) -> None:
    """Without data at hand, all records count as current."""
    of = REPORTS[report]
    committed, out = ROOT / "docs" / of.name / scale, tmp_path / scale
    shutil.copytree(committed, out)
    (out / PAGE).unlink()
    none = tmp_path / "none"
    sized = read_scale(scale, of.scales)
    write_current(of, Resources(sized, none, none, torch.device("cpu")), out)
    assert (out / PAGE).read_text() == (committed / PAGE).read_text()


@pytest.mark.parametrize(
    ("ours", "verdict"),
    [(0.1, "better"), (0.25, "reproduced"), (0.44, "reproduced"), (0.46, "differs")],
)
def test_verdicts(ours: float, verdict: str) -> None:
    """Numbers beside 0.3: better below 0.2, reproduced up to 0.45."""
    assert compare("ē", "mm", ours, 0.3).verdict == verdict


def test_every_table_and_figure_with_a_result_has_a_study() -> None:
    """Tables 1 to 8 and Figures 4 to 21 of the paper; the first three explain the method."""
    labels = sorted(label for study in STUDIES for label in study.labels)
    assert labels == sorted((*PAPER.tables, *PAPER.figures[PAPER.method_figures :]))
