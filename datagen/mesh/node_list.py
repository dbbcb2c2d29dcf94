"""Lists of node numbers: in a case, or in a text file beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

LARGEST_FILE = 50_000_000  # bytes


def read_node_list(path: Path) -> tuple[int, ...]:
    """Read whole numbers that blanks, line ends or commas separate; comments begin with ``#``.

    Raises
    ------
    ValueError
        If there is no such file, or something else stands in it.
    """
    if not path.is_file():
        raise ValueError(f"no such file {path}")
    if path.stat().st_size > LARGEST_FILE:
        raise ValueError(f"{path} has more than {LARGEST_FILE // 10**6} MB")
    lines = path.read_text(errors="replace").splitlines()
    words = [word for line in lines for word in line.partition("#")[0].replace(",", " ").split()]
    for word in words:
        if not (word.isascii() and word.isdigit() and len(word) < 19):
            raise ValueError(f"'{word[:20]}' in {path}, expected whole numbers of nodes")
    return tuple(map(int, words))


def require_different(numbers: tuple[int, ...]) -> None:
    """Raise ValueError if there is no number, or one stands there twice."""
    if not numbers:
        raise ValueError("expected one node at least")
    values, counts = np.unique(numbers, return_counts=True)
    if (counts > 1).any():
        raise ValueError(f"node {values[counts.argmax()]} stands there twice")


def numbered_nodes(
    numbers: tuple[int, ...], first: int, places: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Find the nodes of a mesh by their numbers in its file.

    Parameters
    ----------
    numbers : tuple of int
    first : int
        Number of the first node of the file, 0 or 1.
    places : array of int, (n_nodes,)
        Place of every node in the file from 0, ascending: nodes of no cell are left out.

    Raises
    ------
    ValueError
        If the file has no such node, or it belongs to no cell.
    """
    wanted = np.array(numbers, dtype=np.int64) - first
    found = np.searchsorted(places, wanted).clip(max=len(places) - 1)
    missing = places[found] != wanted
    if missing.any():
        number, last = int(wanted[missing][0]) + first, int(places[-1]) + first
        within = first <= number <= last
        said = "belongs to no cell" if within else f"expected {first} to {last}"
        raise ValueError(f"node {number}: {said}")
    return found
