"""The commands of both programs, each in its own environment."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from tools.open_mpi import SETTINGS

ROOT = Path(__file__).parents[2]
DATAGEN = ROOT / ".venv-datagen" / "bin" / "datagen"
SURROGATE = ROOT / ".venv-surrogate" / "bin" / "surrogate"
MPIRUN = ("mpirun", "-n", "2")
ENVIRONMENT = os.environ | SETTINGS


def execute(*command: str | Path, code: int = 0) -> subprocess.CompletedProcess[str]:
    """Run a command and require its exit code."""
    result = subprocess.run(
        [str(part) for part in command],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == code, result.stderr
    return result
