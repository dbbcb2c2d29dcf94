"""Ranks on two nodes of a hostfile: two daemons of Open MPI on this machine, linked by loopback.

A shell script replaces ssh and starts the daemon of a node on this machine. The daemons do not know
that they share its memory, so the ranks exchange messages by TCP, as between two machines. Each
daemon has its own folder for the shared memory of its ranks.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from mpi4py import MPI

from datagen.cases.case import read_case
from datagen.farm.farm import run
from tests.datagen.farm_runs import assert_same, command, finish, write_case

pytestmark = pytest.mark.mpi

AGENT = """#!/bin/bash
here=$(dirname "$0") node=$1
echo "$node" >> "$here/reached"
export TMPDIR="$here/$node" OMPI_MCA_btl_vader_backing_directory="$here/$node"
mkdir "$TMPDIR"
shift
exec bash -c "$*"
"""
LOOPBACK = ("--mca", "oob_tcp_if_include", "lo", "--mca", "btl_tcp_if_include", "lo")
ONE_SIDED = ("--mca", "osc", "pt2pt", "-x", "MPI4PY_RC_THREAD_LEVEL=funneled")
PAGE = Path(__file__).parents[2] / "docs" / "cluster.md"

Start = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Dataset made by one process, in the folder of its case file."""
    folder = tmp_path_factory.mktemp("serial")
    run(read_case(str(write_case(folder, 40, 10))), folder / "nodal", MPI.COMM_SELF)
    return folder / "nodal"


@pytest.fixture
def on_two_nodes(serial: Path, tmp_path: Path) -> Start:
    """Make a function that runs `datagen run` by one rank on each of two nodes."""
    agent, hosts = tmp_path / "agent", tmp_path / "hosts"
    agent.write_text(AGENT)
    agent.chmod(0o755)
    hosts.write_text("node1 slots=1\nnode2 slots=1\n")

    def start(*options: str) -> subprocess.CompletedProcess[str]:
        mpirun = ["mpirun", "--hostfile", str(hosts), "--display-map", *LOOPBACK, *ONE_SIDED]
        program = command(0, serial.parent / "case.yaml", tmp_path / "nodal")
        done = finish([*mpirun, "--mca", "plm_rsh_agent", str(agent), *program, *options])
        assert sorted((tmp_path / "reached").read_text().split()) == ["node1", "node2"]
        return done

    return start


def test_options_are_those_of_the_page() -> None:
    assert " ".join(ONE_SIDED) in PAGE.read_text()


def ranks_by_node(said: str) -> dict[str, list[int]]:
    """Ranks of each node, from the map that mpirun prints."""
    parts = re.split(r"Data for node: (\w+)", said)[1:]
    found = zip(parts[::2], parts[1::2], strict=True)
    return {node: [int(r) for r in re.findall(r"Process rank: (\d+)", m)] for node, m in found}


@pytest.mark.slow
def test_two_nodes_make_what_one_process_makes(
    on_two_nodes: Start, serial: Path, tmp_path: Path
) -> None:
    done = on_two_nodes()
    assert done.returncode == 0, done.stderr
    assert ranks_by_node(done.stdout) == {"node1": [0], "node2": [1]}
    assert "40 samples solved, 0 failed" in done.stdout
    assert_same(serial, tmp_path / "nodal")


def test_wrong_input_on_two_nodes(on_two_nodes: Start, tmp_path: Path) -> None:
    done = on_two_nodes("--samples", "0")
    assert done.returncode == 2
    assert done.stderr.count("key 'dataset.samples' = 0") == 1
    assert not (tmp_path / "nodal").exists()
