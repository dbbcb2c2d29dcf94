"""How the samples of a dataset are handed out: whole shards first, small pieces at the end.

A group of ranks takes the next piece when it has finished one. Pieces that are whole shards cost no
more than writing them; small ones at the end let all groups finish together, within the time of one
small piece. What a sample is does not depend on the piece that it is solved in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from datagen.cases.case import Case

TAIL = 2  # shards a group that are divided, so that even the last whole one ends before they do
PIECES = 10  # of a divided shard


@dataclass(frozen=True)
class Piece:
    """Samples that one group solves in one go.

    Attributes
    ----------
    shard : int
        Which they belong to.
    numbers : tuple of int
        Sample numbers, ascending.
    of : int
        Into how many pieces what remains of the shard is divided.
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
    """Divide what remains of a dataset into pieces, in the order in which they are taken.

    Parameters
    ----------
    remaining : mapping of int to sequence of int
        Unsolved sample numbers of each unfinished shard, ascending; may be empty.
    groups : int
        Groups of ranks that share the work.
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
