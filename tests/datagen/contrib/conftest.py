from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from mpi4py import MPI

from datagen.cases.case import read_case
from datagen.farm.farm import run
from tests.datagen.farm_runs import write_case

PYTHON = Path(__file__).parents[3] / ".venv-plaid" / "bin" / "python"


@pytest.fixture(scope="session")
def plaid() -> Path:
    """Interpreter of an environment with pyplaid, as the Makefile makes it."""
    has = [
        str(PYTHON),
        "-c",
        "import importlib.util as u, sys; sys.exit(u.find_spec('plaid') is None)",
    ]
    if not PYTHON.exists() or subprocess.run(has, check=False).returncode != 0:
        pytest.skip("there is no pyplaid for this Python")
    return PYTHON


@pytest.fixture(scope="session")
def nodal(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Thirty samples in two shards."""
    folder = tmp_path_factory.mktemp("plaid")
    run(read_case(str(write_case(folder, 30, 20))), folder / "nodal", comm=MPI.COMM_SELF)
    return folder / "nodal"
