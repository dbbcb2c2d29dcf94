"""Sharing work among MPI ranks: groups of ranks, shared counters, results of rank 0 for all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from mpi4py import MPI

from shared_schema.common.errors import InputError

Result = TypeVar("Result")


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


class SharedCounters:
    """Integer counters in the memory of rank 0 that every rank reads and adds to (MPI RMA).

    Additions are atomic. Creation and `close` are collective; `add` and `read` are not.

    Parameters
    ----------
    comm : mpi4py communicator
    *names : str
        Names of the counters, which start at zero.
    """

    def __init__(self, comm: MPI.Comm, *names: str) -> None:
        self._index = {name: i for i, name in enumerate(names)}
        itemsize = MPI.INT64_T.Get_size()
        size = itemsize * len(names) if comm.rank == 0 else 0
        self._window = MPI.Win.Allocate(size, itemsize, comm=comm)
        if comm.rank == 0:
            np.frombuffer(self._window.tomemory(), dtype=np.int64)[:] = 0
        comm.barrier()

    def add(self, name: str, amount: int) -> int:
        """Add to a counter and return its value before the addition."""
        before = np.zeros(1, dtype=np.int64)
        increment = np.array([amount], dtype=np.int64)
        self._window.Lock(0, MPI.LOCK_SHARED)
        self._window.Fetch_and_op(increment, before, 0, self._index[name], MPI.SUM)
        self._window.Unlock(0)
        return int(before[0])

    def read(self, name: str) -> int:
        """Return the value of a counter."""
        return self.add(name, 0)

    def close(self) -> None:
        """Release the memory of the counters (collective)."""
        self._window.Free()
