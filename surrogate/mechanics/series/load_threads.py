"""Loads of a batch, shared by threads while compiled code runs, which needs no lock of Python."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import torch


def in_threads(work: Callable[[slice], object], loads: int, least: int = 1) -> None:
    """Do the work on slices of some loads, in as many threads as PyTorch has.

    Parameters
    ----------
    work : callable
        Takes a slice of the loads; all time is spent in compiled code.
    loads : int
        Number of loads.
    least : int
        Loads of a thread, at least: those of small bodies take less time than its start.
    """
    threads = max(1, min(torch.get_num_threads(), loads // least))
    if threads == 1:
        work(slice(0, loads))
        return
    share = -(-loads // threads)
    shares = [slice(start, min(start + share, loads)) for start in range(0, loads, share)]
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, shares))
