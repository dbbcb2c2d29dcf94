"""Times another program on a problem; runs in the environment of that program.

A problem is a file .npz with the nodes, (n, d) in m, the cells, (m, k), of a type, where nodes are
held, (n, d), the moduli E in Pa and ν, and forces in N, (N, n, d).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

Solve = Callable[[Any], Any]


def measured(prepared: Callable[[dict[str, Any]], Solve]) -> None:
    """Solve all loads, one after the other, and write displacements in m and times in s."""
    problem = dict(np.load(sys.argv[1]))
    began = time.perf_counter()
    solve, found, seconds = prepared(problem), [], []
    for force in problem["force"]:
        found.append(solve(force))
        seconds.append(time.perf_counter() - began)
        began = time.perf_counter()
    np.savez(sys.argv[2], displacement=np.array(found), seconds=np.array(seconds))
