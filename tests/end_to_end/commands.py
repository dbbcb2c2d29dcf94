"""The commands of both programs, each in its own environment."""

from __future__ import annotations

import os
import subprocess
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

from surrogate.command_line import main
from tools.open_mpi import SETTINGS

ROOT = Path(__file__).parents[2]
DATAGEN = ROOT / ".venv-datagen" / "bin" / "datagen"
SURROGATE = ROOT / ".venv-surrogate" / "bin" / "surrogate"
MPIRUN = ("mpirun", "-n", "2")
ENVIRONMENT = os.environ | SETTINGS


def execute(*command: str | Path, code: int = 0) -> subprocess.CompletedProcess[str]:
    """Run a command and require its exit code; those of the learner run in this process."""
    words = [str(part) for part in command]
    if words[0] == str(SURROGATE):
        result = _in_this_process(words)
    else:
        result = subprocess.run(words, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert result.returncode == code, result.stderr
    return result


def _in_this_process(words: list[str]) -> subprocess.CompletedProcess[str]:
    """What a process would have given that does not have to load PyTorch first."""
    out, error = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(error):
        code = main(words[1:])
    return subprocess.CompletedProcess(words, code, out.getvalue(), error.getvalue())
