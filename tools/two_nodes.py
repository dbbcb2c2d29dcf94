"""Two nodes on one machine: network namespaces with names of their own, joined by a virtual cable.

A shell script replaces ssh and starts the daemon of Open MPI on a node. The daemons do not know
that they share a machine, so ranks exchange messages by TCP, as between two machines.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from tools.open_mpi import SETTINGS

AGENT = """#!/bin/bash
echo "$1" >> "$(dirname "$0")/reached"
space={prefix}${{1##*.}} name=node${{1##*.}}
shift
exec ip netns exec "$space" unshare --uts bash -c "hostname $name; $*"
"""


class NoNamespacesError(Exception):
    """Network namespaces cannot be made here; the message says why."""


@dataclass(frozen=True)
class TwoNodes:
    """Addresses and files of two nodes.

    Attributes
    ----------
    folder : Path
        Holds the hostfile, the agent, and ``reached``, a line for each start of a daemon.
    prefix : str
        Beginning of the names of their network namespaces, which end in 1 and 2.
    """

    folder: Path
    prefix: str

    def words(self, program: Sequence[str], ranks: int = 2) -> list[str]:
        """Command that runs a program on the nodes, by mpirun on the first, without options."""
        mpirun = ["mpirun", "--hostfile", str(self.folder / "hosts"), "-n", str(ranks)]
        inside = ["bash", "-c", 'hostname node1; exec "$@"', "bash", *mpirun, *program]
        return ["ip", "netns", "exec", f"{self.prefix}1", "unshare", "--uts", *inside]

    def environment(self) -> dict[str, str]:
        """Environment of the command: the agent of Open MPI 4, and of 5.

        Ranks are not bound to cores: the daemons do not know of each other, and each would bind its
        first rank to the first core of the machine.
        """
        agent = str(self.folder / "agent")
        return {
            **os.environ,
            **SETTINGS,
            "OMPI_MCA_plm_rsh_agent": agent,
            "PRTE_MCA_plm_ssh_agent": agent,
            "OMPI_MCA_hwloc_base_binding_policy": "none",
            "PRTE_MCA_hwloc_default_binding_policy": "none",
        }

    def pids(self, node: int) -> list[int]:
        """Processes on a node."""
        return [int(pid) for pid in _ip("netns", "pids", f"{self.prefix}{node}").split()]


@contextmanager
def two_nodes(folder: Path) -> Iterator[TwoNodes]:
    """Make two nodes with one slot each; remove them at the end.

    Raises
    ------
    NoNamespacesError
        If that needs a right or a program that is not there.
    """
    prefix = f"node{os.getpid() % 100000}n"
    with ExitStack() as stack:
        for node in "12":
            _ip("netns", "add", prefix + node)
            stack.callback(_ip, "netns", "delete", prefix + node)
            _ip("-n", prefix + node, "link", "set", "lo", "up")
        peer = ("type", "veth", "peer", "name", f"{prefix}2", "netns", f"{prefix}2")
        _ip("link", "add", f"{prefix}1", "netns", f"{prefix}1", *peer)
        for node in "12":
            inside = ("-n", prefix + node)
            _ip(*inside, "address", "add", f"10.77.0.{node}/24", "dev", prefix + node)
            _ip(*inside, "link", "set", prefix + node, "up")
        (folder / "hosts").write_text("10.77.0.1 slots=1\n10.77.0.2 slots=1\n")
        (folder / "agent").write_text(AGENT.format(prefix=prefix))
        (folder / "agent").chmod(0o755)
        yield TwoNodes(folder, prefix)


def _ip(*words: str) -> str:
    try:
        done = subprocess.run(["ip", *words], capture_output=True, text=True, check=True)
    except FileNotFoundError:
        raise NoNamespacesError("no program `ip` (package iproute2)") from None
    except subprocess.CalledProcessError as error:
        raise NoNamespacesError(f"ip {' '.join(words)}: {error.stderr.strip()}") from None
    return done.stdout
