"""Studies are done once, and again only where something they depend on, or made, has changed."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from shared_schema.errors import InputError
from shared_schema.figure_style import make_figure
from surrogate.studies.record import Claim, compare
from surrogate.studies.report import PAGE, cell
from surrogate.studies.reproduction import find_studies, reproduce
from surrogate.studies.scale import merged
from surrogate.studies.study import Outcome, Study
from surrogate.studies.workshop import Workshop


def make_studies(calls: list[str]) -> list[Study]:
    """Two studies that say when they are done, on one dataset and on one network."""

    def conduct(name: str) -> Outcome:
        calls.append(name)
        claim = Claim(what="It holds.", holds=True, evidence="1 < 2")
        return Outcome(claims=[claim], figures={"a": (make_figure(1, 1), "Nothing.")})

    labels, question = ("tab: none",), "Does it?"
    return [
        Study("one", "One", labels, question, lambda _: conduct("one"), datasets=("beam2d",)),
        Study("two", "Two", labels, question, lambda _: conduct("two"), runs=("beam2d-d*",)),
    ]


def test_a_second_start_does_nothing(workshop: Workshop, tmp_path: Path) -> None:
    calls: list[str] = []
    studies = make_studies(calls)
    assert reproduce(studies, workshop, tmp_path) == 2
    assert reproduce(studies, workshop, tmp_path) == 0
    assert calls == ["one", "two"]


@pytest.mark.parametrize("lost", ["two.json", "two-a.png"])
def test_what_was_deleted_is_made_again_and_nothing_else(
    workshop: Workshop, tmp_path: Path, lost: str
) -> None:
    calls: list[str] = []
    studies = make_studies(calls)
    reproduce(studies, workshop, tmp_path)
    (tmp_path / lost).unlink()
    assert reproduce(studies, workshop, tmp_path) == 1
    assert calls == ["one", "two", "two"]
    assert (tmp_path / lost).is_file()


def test_another_network_makes_its_studies_again(workshop: Workshop, tmp_path: Path) -> None:
    calls: list[str] = []
    studies = make_studies(calls)
    reproduce(studies, workshop, tmp_path)
    change = {"runs": {"beam2d-det": {"change": {"seed": 1}}}}
    other = type(workshop.scale).model_validate(merged(workshop.scale.model_dump(), change))
    changed = Workshop(other, workshop.data, workshop.runs, torch.device("cpu"))
    reproduce(studies, changed, tmp_path)
    assert calls == ["one", "two", "two"]


def test_a_network_is_trained_once(workshop: Workshop, tmp_path: Path) -> None:
    run = workshop.trained("beam2d-det")
    written = run.model.stat().st_mtime_ns
    fresh = Workshop(workshop.scale, workshop.data, workshop.runs, torch.device("cpu"))
    assert fresh.trained("beam2d-det").folder == run.folder
    assert run.model.stat().st_mtime_ns == written


def test_a_missing_dataset_is_named_before_any_work(workshop: Workshop, tmp_path: Path) -> None:
    calls: list[str] = []
    empty = Workshop(workshop.scale, tmp_path / "none", workshop.runs, torch.device("cpu"))
    with pytest.raises(InputError, match=r"none/beam2d-60/structured"):
        reproduce(make_studies(calls), empty, tmp_path / "out")
    assert calls == []
    assert not (tmp_path / "out").exists()


def test_the_report_has_verdicts_numbers_and_figures(workshop: Workshop, tmp_path: Path) -> None:
    reproduce(find_studies(["deterministic-accuracy"]), workshop, tmp_path)
    text = (tmp_path / PAGE).read_text()
    assert "[Accuracy of deterministic U-Nets](#accuracy-of-deterministic-u-nets)" in text
    assert "| 2D beam (D): ē [mm] |" in text


def test_unknown_study() -> None:
    with pytest.raises(InputError, match=r"study 'table-9': expected one of"):
        find_studies(["table-9"])


@pytest.mark.parametrize(
    ("ours", "verdict"),
    [(0.1, "better"), (0.25, "reproduced"), (0.44, "reproduced"), (0.46, "differs")],
)
def test_verdicts(ours: float, verdict: str) -> None:
    """Against 0.3: better below 0.2, and the same up to 0.45."""
    assert compare("ē", "mm", ours, 0.3).verdict == verdict


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "–"), (3, "3"), (5700, "5700"), (0.06083, "0.0608"), (999.4, "999"), (1060.0, "1060")],
)
def test_cells(value: float | None, text: str) -> None:
    assert cell(value) == text
