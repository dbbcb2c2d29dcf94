"""Division of the samples of a dataset into pieces of work: first whole shards, then small pieces.

A group of ranks takes the next piece when it has finished one. A piece that is a whole shard is
written once, directly. The small pieces at the end let all groups finish at almost the same time,
at most the time of one small piece apart. A sample does not depend on the piece it is solved in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from datagen.cases.case import Case

TAIL = 2  # divided shards per group: enough that the last whole shard ends before they do
PIECES = 10  # pieces of a divided shard, at least


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


def shard_count(case: Case) -> int:
    """Number of shards of the dataset."""
    return -(-case.dataset.samples // case.dataset.shard_size)


def shard_name(shard: int) -> str:
    """File name of a shard."""
    return f"shard-{shard:05d}.h5"


def shard_samples(case: Case, shard: int) -> range:
    """Sample numbers of a shard."""
    size = case.dataset.shard_size
    return range(shard * size, min((shard + 1) * size, case.dataset.samples))


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
