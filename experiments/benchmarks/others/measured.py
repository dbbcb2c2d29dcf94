"""Times another program on a problem; runs in the environment of that program.

A problem is a file .npz with the nodes, (n, d) in m, the cells, (m, k), of a type, where nodes are
held, (n, d), the moduli E in Pa and ν, and forces in N, (N, n, d). Beside a pressure that follows
the surface there are its facets, (f, k), and pressures in Pa, (N,); volume is then constrained.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

Solve = Callable[..., Any]
SIX = [[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]]


def tetrahedra(cells: Any) -> Any:
    """Split hexahedra into six each, for programs that know no other cells."""
    return cells[:, SIX].reshape(-1, 4) if cells.shape[1] == 8 else cells


def clock() -> float:
    """Seconds of processor time, with those of compilers that were called."""
    others = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + others.ru_utime + others.ru_stime


def measured(prepared: Callable[[dict[str, Any]], Solve]) -> None:
    """Solve all loads, one after the other, and write displacements in m and times in s.

    Displacements of a load that fails are NaN.
    """
    problem = dict(np.load(sys.argv[1]))
    loads = [problem[name] for name in ("force", "pressure") if name in problem]
    began = clock()
    solve, found, seconds = prepared(problem), [], []
    for load in zip(*loads, strict=True):
        try:
            found.append(solve(*load))
        except Exception as error:  # whatever a program raises where it finds no equilibrium
            print(f"{type(error).__name__}: {error}", file=sys.stderr)
            found.append(np.full_like(problem["x"], np.nan))
        seconds.append(clock() - began)
        began = clock()
    np.savez(sys.argv[2], displacement=np.array(found), seconds=np.array(seconds))
