"""Sharing work among MPI ranks: groups of ranks, results of rank 0 for all, the first of a node."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from mpi4py import MPI

from shared_schema.common.errors import InputError

Result = TypeVar("Result")
SHARED_MEMORY = "/dev/shm"  # no disk, so that it is not full when a disk is


def on_rank_zero(comm: MPI.Comm, work: Callable[[], Result]) -> Result:
    """Do `work` on rank 0; every rank returns its result or raises its InputError (collective)."""
    result: Result | None = None
    error: InputError | None = None
    if comm.rank == 0:
        try:
            result = work()
        except InputError as wrong:
            error = wrong
    if comm.size > 1:
        result, error = comm.bcast((result, error), root=0)
    if error is not None:
        raise error
    return result  # type: ignore[return-value]


@dataclass(frozen=True)
class RankGroup:
    """The group of ranks that this rank solves with; all groups have the same size.

    Attributes
    ----------
    world : mpi4py communicator
        All ranks.
    comm : mpi4py communicator
        Ranks of this group.
    number : int
        Number of this group, from 0.
    """

    world: MPI.Comm
    comm: MPI.Comm
    number: int

    @classmethod
    def of(cls, world: MPI.Comm, size: int) -> RankGroup:
        """Divide all ranks into groups of `size` consecutive ranks (collective).

        Raises
        ------
        InputError
            On every rank, if `size` does not divide the number of ranks.
        """
        if size < 1 or world.size % size:
            raise InputError(
                f"--ranks-per-solve {size}: expected a divisor of the {world.size} ranks there are"
            )
        if size == 1:
            return cls(world, MPI.COMM_SELF, world.rank)
        number = world.rank // size
        return cls(world, world.Split(number, world.rank), number)

    @property
    def count(self) -> int:
        """Number of groups."""
        return int(self.world.size // self.comm.size)

    @property
    def is_leader(self) -> bool:
        """True if this rank is the first of its group, which reports and writes for the group."""
        return bool(self.comm.rank == 0)

    def agree(self, ask: Callable[[], Result]) -> Result:
        """Call `ask` on the leader; every rank of the group returns its answer (collective)."""
        answer = ask() if self.is_leader else None
        if self.comm.size > 1:
            answer = self.comm.bcast(answer, root=0)
        return answer  # type: ignore[return-value]


class FirstOfNode:
    """Which rank of a node is the first to raise its hand (made collectively).

    All ranks of a node hold a file that has no name any more, and append a byte to it. No messages
    are sent, so that it works while other ranks are busy, wait for this one, or have ended.

    Parameters
    ----------
    comm : mpi4py communicator
    """

    def __init__(self, comm: MPI.Comm) -> None:
        node = comm.Split_type(MPI.COMM_TYPE_SHARED)
        with tempfile.NamedTemporaryFile(dir=SHARED_MEMORY) as file:
            path = node.bcast(file.name, root=0)
            self._file = os.open(path, os.O_WRONLY | os.O_APPEND)
            node.barrier()
        node.Free()

    def claim(self) -> bool:
        """Raise this rank's hand; True if it is the first of the node."""
        os.write(self._file, b"!")
        return os.lseek(self._file, 0, os.SEEK_CUR) == 1

    def close(self) -> None:
        """Release the file."""
        os.close(self._file)
