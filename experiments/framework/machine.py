"""Machine and software of a measurement, for its record."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Any

from shared_schema.common import processor

ROOT = Path(__file__).parents[2]
PACKAGES = ("torch", "numpy", "onnxruntime")


def machine() -> dict[str, Any]:
    """Describe the processor, and the load before the measurement (`with_load_after`)."""
    return {
        "processor": processor(),
        "cores": os.cpu_count(),
        "load_averages": [_load_average()],
    }


def with_load_after(described: dict[str, Any]) -> dict[str, Any]:
    """Add the load after the measurement."""
    before = described.get("load_averages", [_load_average()])
    return {**described, "load_averages": [*before[:1], _load_average()]}


def software() -> dict[str, str]:
    """Versions of Python, of the packages that are installed, and commit of the source."""
    found = {"python": platform.python_version(), **_solver()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return {**found, "commit": commit()}


def _solver() -> dict[str, str]:
    """Versions of the finite-element software; none in the learner's environment."""
    try:
        import dolfinx
    except ImportError:
        return {}
    from mpi4py import MPI
    from petsc4py import PETSc

    mpi, version = MPI.get_vendor()
    return {
        "dolfinx": dolfinx.__version__,
        "petsc": ".".join(str(part) for part in PETSc.Sys.getVersion()),
        "mpi": f"{mpi} {'.'.join(str(part) for part in version)}",
    }


def commit() -> str:
    """Commit of the working tree, or what the environment variable COMMIT says of a copy."""
    if told := os.environ.get("COMMIT"):
        return told
    command = ["git", "describe", "--always", "--dirty"]
    try:
        asked = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return "unknown"
    return asked.stdout.strip() or "unknown"


def _load_average() -> float:
    """Mean number of running processes over the last minute."""
    return round(os.getloadavg()[0], 2)
