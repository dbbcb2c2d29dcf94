"""Environments with packages of others, which a measurement makes for itself."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path


def python_with(folder: Path, packages: Iterable[str]) -> Path:
    """Return the Python of an environment with some packages, made in a folder unless it is."""
    python = folder / "bin" / "python"
    if not (folder / "installed").is_file():
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
        subprocess.run([str(python), "-m", "pip", "install", "-q", *packages], check=True)
        (folder / "installed").touch()
    return python
