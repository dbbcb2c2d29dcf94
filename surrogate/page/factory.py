"""The program `datagen`, which another environment may have."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from shared_schema.common.errors import InputError

NONE = "no program datagen on the PATH, expected it (pip install 'solid-datagen[mesh]')"


def run_datagen(*words: str | Path) -> None:
    """Run one command of `datagen`; InputError says what it refuses."""
    beside = shutil.which("datagen", path=str(Path(sys.executable).parent))
    program = beside or shutil.which("datagen")
    if program is None:
        raise InputError(NONE)
    made = subprocess.run([program, *map(str, words)], capture_output=True, text=True)
    if made.returncode != 0:
        said = made.stderr.strip().splitlines() or [f"exit code {made.returncode}"]
        raise InputError(said[-1].removeprefix("datagen: error: "))
