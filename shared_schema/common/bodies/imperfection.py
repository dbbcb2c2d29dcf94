"""The imperfection of a body: which of two mirror states it buckles into."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def imperfection(shape: tuple[int, ...], seed: int = 0) -> NDArray[np.float64]:
    """Random vector at every node, (n_nodes, d), normal with σ = 1.

    No real body is perfectly straight. Where an equilibrium loses its stability, the part of the
    imperfection along the lowest mode decides in which direction the body goes.
    """
    return np.random.default_rng(seed).standard_normal(shape)
