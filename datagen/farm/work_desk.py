"""The desk at which groups of ranks fetch their work: rank 0 keeps it, the others send messages.

A group asks for a piece of work when it has finished one, and rank 0, which solves too, answers
between the Newton iterations of its own solves. Samples are counted where they are solved; the
counts travel with the questions, and alone only after a while. Nothing else is sent between groups,
so that any network will do. A rank ends itself when the program that started it, mpirun or its
daemon, has ended: Open MPI 5 leaves ranks behind when it loses a node.

Pieces of work are first whole shards, then small pieces. A piece that is a whole shard is
written once, directly; small pieces are kept, and put together when all are solved. They let all
groups finish at almost the same time, at most the time of one small piece apart. A sample does not
depend on the piece it is solved in.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from mpi4py import MPI

from shared_schema.common.errors import FAILED

QUESTION, ANSWER, STOP, CLOSED = 1, 2, 3, 4  # tags
LOOK = 1e-3  # seconds between two looks of rank 0 at its questions, at least
WAIT = 1e-4  # seconds between two looks of another rank for its answer
TELL = 0.5  # seconds after which counts are sent alone
TAIL = 2  # divided shards per group: enough that the last whole shard ends before they do
PIECES = 10  # pieces of a divided shard, at least


class WorkDesk:
    """Hands out numbers of pieces of work, and counts what is done (made collectively).

    Parameters
    ----------
    comm : mpi4py communicator
        All ranks.
    leaders : list of int
        Ranks that fetch work, rank 0 first.

    Attributes
    ----------
    samples, failed : int
        On rank 0: number of samples done as far as it knows, and of those without an equilibrium.
    is_stopping : bool
        True if a rank has asked all to stop, as far as this rank knows. Rank 0 and the leaders come
        to know.
    """

    def __init__(self, comm: MPI.Comm, leaders: list[int]) -> None:
        self._comm = comm.Dup()
        self._leaders = leaders
        self._is_keeper = comm.rank == 0
        self._parent = os.getppid()
        self.samples = self.failed = 0
        self.is_stopping = self._has_asked = self._is_told_to_stop = False
        self._taken = self._ended = 0
        self._told = self._looked = time.monotonic()
        self._sent: list[MPI.Request] = []

    # --- on every rank -------------------------------------------------------------------------

    def take(self) -> int:
        """Number of the next piece of work, from 0 (for leaders)."""
        if self._is_keeper:
            return self._next()
        self._send("take")
        return self._hear(ANSWER)

    def count(self, solved: bool) -> None:
        """Count a sample that is done (for leaders)."""
        self.samples += 1
        self.failed += not solved
        if not self._is_keeper and time.monotonic() - self._told > TELL:
            self._send("count")

    def stop(self) -> None:
        """Ask all to stop."""
        if self._is_keeper:
            self._stop_all()
        elif not self._has_asked:
            self._has_asked = self.is_stopping = True
            self._send("stop")

    def look(self) -> None:
        """See what has come: questions to rank 0, which it answers, or a word to stop."""
        now = time.monotonic()
        if now - self._looked < LOOK:
            return
        self._looked = now
        self._require_parent()
        if self._is_keeper:
            while self._comm.iprobe(tag=QUESTION):
                self._answer()
        elif not self._is_told_to_stop and self._comm.iprobe(source=0, tag=STOP):
            self._hear(STOP)
            self._is_told_to_stop = self.is_stopping = True

    def close(self, show: Callable[[], None]) -> None:
        """Wait until no rank needs the desk; rank 0 calls `show` meanwhile (collective)."""
        if self._is_keeper:
            while self._ended < self._comm.size - 1:
                self.look()
                show()
                time.sleep(LOOK)
            for rank in range(1, self._comm.size):
                self._comm.send(self.is_stopping, dest=rank, tag=CLOSED)
        else:
            self._send("end")
            self.is_stopping = bool(self._hear(CLOSED))
            if self.is_stopping and self._comm.rank in self._leaders and not self._is_told_to_stop:
                self._hear(STOP)
        MPI.Request.Waitall(self._sent)
        self._comm.Free()

    # --- messages --------------------------------------------------------------------------------

    def _hear(self, tag: int) -> int:
        """Wait for a message of rank 0 and return it."""
        while not self._comm.iprobe(source=0, tag=tag):
            self._require_parent()
            time.sleep(WAIT)
        return int(self._comm.recv(source=0, tag=tag))

    def _require_parent(self) -> None:
        """End this rank at once if it is left behind: no messages can be sent any more."""
        if self._comm.size > 1 and os.getppid() != self._parent:
            os._exit(FAILED)

    def _send(self, word: str) -> None:
        """Send a word to rank 0, and the counts since the last one."""
        message = word, self.samples, self.failed
        self._sent = [request for request in self._sent if not request.Test()]
        self._sent.append(self._comm.isend(message, dest=0, tag=QUESTION))
        self.samples = self.failed = 0
        self._told = time.monotonic()

    def _answer(self) -> None:
        """Receive one message on rank 0, and answer it if it is a question."""
        status = MPI.Status()
        word, samples, failed = self._comm.recv(tag=QUESTION, status=status)
        self.samples += samples
        self.failed += failed
        if word == "take":
            self._comm.send(self._next(), dest=status.Get_source(), tag=ANSWER)
        elif word == "stop":
            self._stop_all()
        elif word == "end":
            self._ended += 1

    def _next(self) -> int:
        self._taken += 1
        return self._taken - 1

    def _stop_all(self) -> None:
        if not self.is_stopping:
            self.is_stopping = True
            self._sent += [
                self._comm.isend(True, dest=leader, tag=STOP) for leader in self._leaders[1:]
            ]


@dataclass(frozen=True)
class Piece:
    """A piece of work: samples of one shard that a group of ranks solves.

    Attributes
    ----------
    shard : int
        Number of the shard.
    numbers : tuple of int
        Sample numbers, ascending.
    of : int
        Number of pieces into which the unsolved samples of the shard are divided.
    """

    shard: int
    numbers: tuple[int, ...]
    of: int


def plan(remaining: Mapping[int, Sequence[int]], groups: int) -> list[Piece]:
    """Divide the unsolved samples of a dataset into pieces, in the order in which they are taken.

    Parameters
    ----------
    remaining : mapping of int to sequence of int
        Unsolved sample numbers of each unfinished shard, ascending; they may be empty.
    groups : int
        Number of groups of ranks that share the work.
    """
    shards = sorted(remaining)
    tail = shards[-TAIL * groups :] if groups > 1 else []
    pieces_each = max(PIECES, -(-PIECES * groups // max(1, len(tail))))
    pieces: list[Piece] = []
    for shard in shards:
        numbers = tuple(remaining[shard])
        count = min(pieces_each, max(1, len(numbers))) if shard in tail else 1
        bounds = [len(numbers) * i // count for i in range(count + 1)]
        for start, stop in pairwise(bounds):
            pieces.append(Piece(shard, numbers[start:stop], count))
    return pieces
