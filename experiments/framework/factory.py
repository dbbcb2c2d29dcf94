"""The factory as benchmarks run it: its command, whatever environment they are in."""

from __future__ import annotations

import subprocess

from experiments.framework.machine import ROOT

FACTORY = ROOT / ".venv-datagen" / "bin" / "datagen"


def factory(*words: object, quiet: bool = False) -> None:
    """Run a command of `datagen`."""
    subprocess.run([str(FACTORY), *map(str, words)], check=True, capture_output=quiet)
