"""Work plan: every sample belongs to one piece, and all groups finish at almost the same time."""

from __future__ import annotations

import heapq

import numpy as np
import pytest

from datagen.farm.work_plan import Piece, plan

SIZE = 50  # number of samples of a shard


def whole(shards: int) -> dict[int, range]:
    return {k: range(k * SIZE, (k + 1) * SIZE) for k in range(shards)}


def idle_time(pieces: list[Piece], groups: int, times: np.ndarray) -> float:
    """Time between the end of a group's last piece and the end of all, summed over the groups."""
    ends = [0.0] * groups
    for piece in pieces:
        heapq.heapreplace(ends, ends[0] + float(times[list(piece.numbers)].sum()))
    return sum(max(ends) - end for end in ends)


@pytest.mark.parametrize(("shards", "groups"), [(710, 2), (710, 64), (4, 2), (3, 8), (1, 100)])
def test_every_sample_is_in_one_piece(shards: int, groups: int) -> None:
    pieces = plan(whole(shards), groups)
    assert [n for piece in pieces for n in piece.numbers] == list(range(shards * SIZE))
    for shard in range(shards):
        assert {p.of for p in pieces if p.shard == shard} == {sum(p.shard == shard for p in pieces)}


def test_one_group_gets_whole_shards() -> None:
    assert [piece.of for piece in plan(whole(5), 1)] == [1] * 5


def test_only_unsolved_samples_are_in_pieces() -> None:
    """A shard with two unsolved samples, and one that is solved but not yet merged."""
    pieces = plan({3: [151, 190], 7: []}, 2)
    assert [piece.numbers for piece in pieces] == [(151,), (190,), ()]
    assert [piece.of for piece in pieces] == [2, 2, 1]


@pytest.mark.parametrize("groups", [2, 16, 64, 128])
def test_all_groups_end_together(groups: int) -> None:
    """710 shards, solve times with a standard deviation of 30 %.

    The idle time is below 2 % of the work, and at most a fifth of that with whole shards only.
    """
    generator = np.random.default_rng(0)
    times = generator.lognormal(sigma=0.3, size=710 * SIZE)
    ours = idle_time(plan(whole(710), groups), groups, times)
    coarse = [Piece(k, tuple(numbers), 1) for k, numbers in whole(710).items()]
    assert ours < 0.02 * times.sum()
    assert ours <= 0.2 * idle_time(coarse, groups, times)
    longest = max(times[list(p.numbers)].sum() for p in plan(whole(710), groups) if p.of > 1)
    assert ours <= groups * longest
