"""Ranks on two nodes of a hostfile, which exchange messages by TCP (see `tools.two_nodes`)."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from mpi4py import MPI

from datagen.cases.case import read_case
from datagen.farm.farm import run
from shared_schema.checker import check_dataset
from tests.datagen.farm_runs import assert_same, command, held, recorded, wait_until, write_case
from tools.two_nodes import NoNamespacesError, TwoNodes, two_nodes

pytestmark = pytest.mark.mpi
SECOND = "10.77.0.2"
SAMPLES, SHARD = 240, 20


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Dataset made by one process, in the folder of its case file."""
    folder = tmp_path_factory.mktemp("serial")
    run(read_case(str(write_case(folder, SAMPLES, SHARD))), folder / "nodal", comm=MPI.COMM_SELF)
    return folder / "nodal"


@pytest.fixture
def nodes(tmp_path: Path) -> Iterator[TwoNodes]:
    try:
        with two_nodes(tmp_path) as made:
            yield made
    except NoNamespacesError as error:
        pytest.skip(f"no two nodes here: {error}")


def run_on(nodes: TwoNodes, serial: Path) -> list[str]:
    """`datagen run` by one process."""
    return command(0, serial.parent / "case.yaml", nodes.folder / "nodal")


def start(nodes: TwoNodes, program: list[str]) -> subprocess.Popen[str]:
    """Begin a program by one rank on each node, with no option of mpirun but the hostfile."""
    return subprocess.Popen(
        nodes.words(program),
        env=nodes.environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.slow
def test_two_nodes_make_what_one_process_makes(nodes: TwoNodes, serial: Path) -> None:
    with start(nodes, run_on(nodes, serial)) as process:
        out, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    assert (nodes.folder / "reached").read_text().split() == [SECOND]
    assert f"{SAMPLES} samples solved, 0 failed" in out
    assert_same(serial, nodes.folder / "nodal")


@pytest.mark.faults
@pytest.mark.slow
def test_a_node_dies(nodes: TwoNodes, serial: Path) -> None:
    """Every process of the second node is killed: the run ends, and the next one completes it.

    Open MPI 5 says so, but returns 0 and leaves the first node's ranks to end themselves.
    """
    nodal = nodes.folder / "nodal"
    with start(nodes, held(run_on(nodes, serial), nodes.folder / "gate", 3)) as process:
        wait_until(lambda: recorded(nodal) >= 3, process)
        for pid in nodes.pids(2):
            os.kill(pid, signal.SIGKILL)
        (nodes.folder / "gate").unlink()
        process.communicate(timeout=120)
    assert not (nodal / "manifest.json").exists()
    limit = time.monotonic() + 120
    while nodes.pids(1):
        assert time.monotonic() < limit
        time.sleep(0.01)
    kept = recorded(nodal)
    assert 3 <= kept < SAMPLES // SHARD
    with start(nodes, run_on(nodes, serial)) as process:
        _, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    assert check_dataset(nodal) == []
    assert_same(serial, nodal)
