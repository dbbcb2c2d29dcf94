"""One model called by several threads at once, each answer beside that of one thread.

The worker's process executes it as the command ``threads RUN SEED``.
"""

from __future__ import annotations

import sys
import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np

import surrogate

THREADS, CALLS = 4, 16


def main(words: list[str]) -> int:
    """Compare; exit code 1 if an answer differs."""
    run, seed = words[1], int(words[2])
    warnings.simplefilter("ignore", surrogate.OutsideTrainingWarning)
    model, random = surrogate.load(run), np.random.default_rng(seed)
    loads = np.zeros((CALLS, *model.geometry.coordinates.shape))
    nodes = random.choice(np.flatnonzero(~model.geometry.clamped), CALLS)
    loads[np.arange(CALLS), nodes] = random.uniform(-0.5, 0.5, (CALLS, loads.shape[2]))

    def answer(call: int) -> list[np.ndarray]:
        u = model.predict(loads[call])
        found = [u, model.predict(loads[: 1 + call % 5])]
        if model.is_stochastic:
            found.append(model.predict_distribution(loads[call], passes=3, seed=call).std)
        if call % 4 == 0:
            found.append(model.certify(loads[call], u).error)
        return found

    alone = [answer(call) for call in range(CALLS)]
    with ThreadPoolExecutor(THREADS) as pool:
        together = list(pool.map(answer, range(CALLS)))
    wrong = sum(
        not all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
        for one, other in zip(alone, together, strict=True)
    )
    if wrong:
        print(f"{wrong} of {CALLS} answers differ from those of one thread", file=sys.stderr)
    return 1 if wrong else 0
