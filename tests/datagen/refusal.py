"""Wrong input to the command `datagen`: exit code 2 and one line."""

from __future__ import annotations

import pytest

from datagen.command_line import main


def refusal(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command that must refuse its input; return the one line on standard error."""
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error
