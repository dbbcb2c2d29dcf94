from __future__ import annotations

import itertools
from collections.abc import Callable

import pytest

from shared_schema.common.command_line import Progress, run_command
from shared_schema.common.errors import InputError, WorkError


def raising(error: BaseException | None) -> Callable[[], None]:
    def command() -> None:
        if error is not None:
            raise error

    return command


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (None, 0, ""),
        (WorkError("no equilibrium"), 1, "prog: failed: no equilibrium\n"),
        (OSError(28, "No space left on device"), 1, "prog: failed: [Errno 28] No space left"),
        (KeyboardInterrupt(), 1, "prog: stopped"),
        (InputError("key 'a' = 1"), 2, "prog: error: key 'a' = 1\n"),
    ],
)
def test_exit_code_and_line(
    error: BaseException | None, code: int, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command("prog", raising(error)) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(line)
    assert captured.err.count("\n") == (0 if error is None else 1)


def test_one_of_many_ranks_says_what_is_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command("prog", raising(InputError("key")), speaks=False) == 2
    assert capsys.readouterr().err == ""


def test_mistakes_of_the_program_are_not_hidden() -> None:
    with pytest.raises(ZeroDivisionError):
        run_command("prog", raising(ZeroDivisionError()))


def test_progress_prints_plain_lines(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A clock that goes 6 s a call: a line every 10 s is a line at every second update.

    Began at 0 s, with 10 of 100 units done. Updates ask for the time at 6 s (no line) and 12 s;
    the line is made at 18 s with 30 units: (30 - 10) / 18 = 1.1 a second, 70 / 1.11 = 63 s left.
    """
    clock = itertools.count(0.0, 6.0)
    monkeypatch.setattr("shared_schema.common.command_line.time.perf_counter", lambda: next(clock))
    progress = Progress(100, 10, "steps", "train")
    progress.update(20, "loss 2")
    progress.update(30, "loss 1")
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "train: 30/100 steps, 1.1/s, 63 s left, loss 1\n"
    progress.close("done")
    assert capsys.readouterr().err.endswith(", done\n")


def test_silent_progress(capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress(10, silent=True)
    progress.update(10)
    progress.close()
    assert capsys.readouterr().err == ""


def test_progress_without_any_advance(capsys: pytest.CaptureFixture[str]) -> None:
    Progress(10, 4, "steps", "train").close()
    assert capsys.readouterr().err == "train: 4/10 steps, 0.0/s, time left unknown\n"
