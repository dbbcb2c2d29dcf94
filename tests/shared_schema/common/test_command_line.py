from __future__ import annotations

import logging
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from shared_schema.common.command_line import add_command, make_parser, run_command
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


def test_an_empty_path_is_not_the_working_directory(capsys: pytest.CaptureFixture[str]) -> None:
    parser, commands = make_parser("prog", "does nothing", "1")
    add_command(commands, "run", "run").add_argument("--out", type=Path)
    assert parser.parse_args(["run", "--out", "a"]).out == Path("a")
    with pytest.raises(SystemExit):
        parser.parse_args(["run", "--out", ""])
    assert "argument --out: expected a path, not an empty text" in capsys.readouterr().err


def test_one_of_many_ranks_says_what_is_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command("prog", raising(InputError("key")), speaks=False) == 2
    assert capsys.readouterr().err == ""


def test_mistakes_of_the_program_are_not_hidden() -> None:
    with pytest.raises(ZeroDivisionError):
        run_command("prog", raising(ZeroDivisionError()))


def test_what_the_library_logs_is_printed_by_a_command(capsys: pytest.CaptureFixture[str]) -> None:
    logger = logging.getLogger("prog.part")

    def command() -> None:
        logger.info("from epoch %d on", 3)
        logger.warning("a load out of range")

    assert run_command("prog", command) == 0
    assert capsys.readouterr().err == (
        "prog: from epoch 3 on\nprog: warning: a load out of range\n"
    )
    command()
    assert "prog:" not in capsys.readouterr().err


PRINTS = """
import sys
from shared_schema.common.command_line import add_command, make_parser, parsed, run_command
parser, commands = make_parser("prog", "prints", "1")
add_command(commands, "run", "run")
parsed(parser, ["run"])
sys.exit(run_command("prog", lambda: print("0.1 µm")))
"""


def test_a_stream_that_cannot_encode_escapes() -> None:
    """A micrometre in ASCII, as in a locale of before UTF-8."""
    words = [sys.executable, "-c", PRINTS]
    surroundings = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(words, env=surroundings, capture_output=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"0.1 \\xb5m\n", b"")


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_closed_streams(closed: str) -> None:
    """A service manager may start a program without them."""
    words = ["sh", "-c", f'exec "$0" -c "$1" {closed}', sys.executable, PRINTS]
    done = subprocess.run(words, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
