r"""Score predictions for the hidden test: one line of JSON.

    python score.py PREDICTIONS.npz ANSWERS.npz

Both files have ``number``, (M,), sample numbers in any order, and ``displacement``,
(M, n_nodes, d) in m. With the predictions U and the answers u of sample m,

.. math::
    e_m = \frac{1}{n d} \sum_{a,i} |U_{ai} - u_{ai}|, \qquad
    w_m = \frac{\max_a ‖U_a - u_a‖}{\max_a ‖u_a‖}

``mean_error`` is the mean of e in m, ``relative_mean_error`` that of e over the largest
displacement of a node, ``worst_node_error`` the mean of w, ``largest_worst_node_error`` its largest
value, and ``within_tolerance`` the share of the samples with w ≤ 0.005. This file needs NumPy only.
Wrong input ends it with exit code 2 and one line.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

TOLERANCE = 0.005  # of the worst node, relative to the largest displacement of the sample
Columns = tuple[Any, Any]  # sample numbers and displacements


def columns(path: Path) -> Columns:
    """Read sample numbers, ascending, and displacements in m; ValueError if there are none."""
    try:
        with np.load(path) as file:
            number, u = file["number"], np.asarray(file["displacement"], dtype=np.float64)
    except (OSError, ValueError, KeyError, TypeError, EOFError, BadZipFile, IndexError):
        expected = "a file .npz with numbers 'number' and 'displacement'"
        raise ValueError(f"{path}: expected {expected}") from None
    if number.ndim != 1 or u.ndim != 3 or len(number) != len(u):
        shapes = f"'number' {number.shape} and 'displacement' {u.shape}"
        raise ValueError(f"{path}: {shapes}, expected (M,) and (M, node, component)")
    order = np.argsort(number)
    return number[order], u[order]


def scores(predictions: Path, answers: Path) -> dict[str, float]:
    """Compare two files; ValueError, with one line, unless they fit together."""
    (number, predicted), (expected, u) = columns(predictions), columns(answers)
    if (missing := np.setdiff1d(expected, number)).size:
        of = f"{len(missing)} of {len(expected)} samples, number {missing[0]} for one"
        raise ValueError(f"{predictions}: no prediction for {of}")
    if not np.array_equal(number, expected):
        raise ValueError(f"{predictions}: expected each sample of the test once, and no other")
    if predicted.shape != u.shape:
        raise ValueError(f"{predictions}: 'displacement' {predicted.shape}, expected {u.shape}")
    if not (finite := np.isfinite(predicted).all(axis=(1, 2))).all():
        first = number[~finite][0]
        raise ValueError(f"{predictions}: sample {first} has values that are not finite")
    error, largest = predicted - u, np.linalg.norm(u, axis=2).max(axis=1)
    largest = np.where(largest > 0, largest, np.inf)
    mean, worst = np.abs(error).mean(axis=(1, 2)), np.linalg.norm(error, axis=2).max(axis=1)
    return {
        "samples": len(u),
        "mean_error": float(mean.mean()),
        "relative_mean_error": float((mean / largest).mean()),
        "worst_node_error": float((worst / largest).mean()),
        "largest_worst_node_error": float((worst / largest).max()),
        "within_tolerance": float((worst <= TOLERANCE * largest).mean()),
    }


def main(words: list[str]) -> int:
    """Print the scores; return the exit code."""
    try:
        if len(words) != 2:
            raise ValueError("expected PREDICTIONS.npz ANSWERS.npz")
        print(json.dumps(scores(Path(words[0]), Path(words[1]))))
    except ValueError as error:
        print(f"score: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
