from __future__ import annotations

import itertools

import pytest

from shared_schema.common.progress import LoadProgress, Progress, shown_progress


def test_progress_prints_plain_lines(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A clock that goes 6 s a call: a line every 10 s is a line at every second update.

    Began at 0 s, with 10 of 100 units done. Updates ask for the time at 6 s (no line) and 12 s;
    the line is made at 18 s with 30 units: (30 - 10) / 18 = 1.1 a second, 70 / 1.11 = 63 s left.
    """
    clock = itertools.count(0.0, 6.0)
    monkeypatch.setattr("shared_schema.common.progress.time.perf_counter", lambda: next(clock))
    with shown_progress():
        progress = Progress(100, 10, "steps", "train")
    progress.update(20, "loss 2")
    progress.update(30, "loss 1")
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "train: 30/100 steps, 1.1/s, 63 s left, loss 1\n"
    progress.close("done")
    assert capsys.readouterr().err.endswith(", done\n")


def test_progress_without_any_advance(capsys: pytest.CaptureFixture[str]) -> None:
    with shown_progress():
        Progress(10, 4, "steps", "train").close()
    assert capsys.readouterr().err == "train: 4/10 steps, 0.0/s, time left unknown\n"


def test_what_is_silent(capsys: pytest.CaptureFixture[str]) -> None:
    """Work outside of a command, passing work at its end, and what is said to be silent."""
    Progress(10, 4, "steps", "train").close()
    with shown_progress():
        for options in ({"silent": True}, {"passing": True}):
            progress = Progress(10, 4, "steps", "train", **options)
            progress.update(10)
            progress.close()
    assert capsys.readouterr().err == ""


def test_progress_of_a_load(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """From 100 N to 1e-8 N are ten powers of ten; 1e-3 N is half of the way, to half the load."""
    monkeypatch.setattr("shared_schema.common.progress.LINE_EVERY", 0.0)
    with shown_progress():
        progress = LoadProgress("solve")
    progress.begin(0.0, 0.5)
    parts = []
    for number, residual in enumerate((1.0, 100.0, 1e-3, float("nan"), 1e-9)):
        progress.step(number, residual, 1e-8)
        parts.append(progress.part)
    assert parts == pytest.approx([0, 0, 0.25, 0.25, 0.5])
    progress.begin(0.5, 1.0)
    progress.step(0, 1.0, 0.0)  # no tolerance is known
    assert progress.part == 0.5
    progress.close()
    lines = capsys.readouterr().err.splitlines()
    assert lines[2].startswith("solve: 25/100 % of the load, ")
    assert lines[2].endswith(" left, Newton step 3 to 0.5 of it, residual 0.001 N")
    assert len(lines) == 6
