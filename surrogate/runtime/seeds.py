"""Independent streams of random numbers from one seed."""

from __future__ import annotations

import numpy as np

(
    INITIAL_WEIGHTS,
    VALIDATION,
    ORDER,
    NOISE,
    PASS,
    CALIBRATION,
    REFINEMENT,
    PATHS,
) = range(8)


def stream(*numbers: int) -> int:
    """Return a 64-bit seed made from some numbers; different numbers give different seeds."""
    entropy = (len(numbers), *numbers)
    return int(np.random.SeedSequence(entropy).generate_state(1, np.uint64)[0])
