"""One model whose arguments and results are written to between calls: each answer stays the same.

The worker's process executes it as the command ``aliasing RUN SEED``.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import torch

import surrogate

CALLS = 12


def main(words: list[str]) -> int:
    """Call at random, overwrite what was returned; exit code 1 if an answer or a load changes."""
    run, random = words[1], np.random.default_rng(int(words[2]))
    warnings.simplefilter("ignore")
    model = surrogate.load(run)
    nodes = np.flatnonzero(~model.geometry.clamped)
    wrong = []
    for _ in range(CALLS):
        force = np.zeros(model.geometry.coordinates.shape)
        force[random.choice(nodes, 2)] = random.uniform(-0.2, 0.2, (2, model.geometry.dimension))
        ways = calls(model)
        name = random.choice(list(ways))
        given = force.copy()
        first = arrays_of(ways[name](given))
        kept = [array.copy() for array in first]
        if not np.array_equal(given, force):
            wrong.append(f"{name} writes to the load")
        for array in first:
            if array.flags.writeable:
                array[...] = 7.0
        again = arrays_of(ways[name](force.copy()))
        if not all(np.array_equal(a, b, equal_nan=True) for a, b in zip(kept, again, strict=True)):
            wrong.append(f"{name} reads what it returned")
    if wrong:
        print("; ".join(sorted(set(wrong))), file=sys.stderr)
    return 1 if wrong else 0


def calls(model: surrogate.Surrogate) -> dict[str, Callable[[np.ndarray], Any]]:
    """Public ways from a load to a result."""
    young = model.description.data.material
    ways: dict[str, Callable[[np.ndarray], Any]] = {
        "predict": model.predict,
        "predict of a tensor": lambda f: model.predict(torch.from_numpy(f)),
        "solve": model.solve,
        "solve with stresses": lambda f: model.solve(f, stresses=True, certify="full"),
        "solve with a body force": lambda f: model.solve(f, body_force=[0.01] * f.shape[1]),
        "solve within a tolerance": lambda f: model.solve(f, tolerance=5e-3),
        "solve corrected": lambda f: model.solve(f, correct=True),
        "certify": model.certify,
        "correct": model.correct,
    }
    if hasattr(young, "young_modulus"):
        stiff = 2 * young.young_modulus
        ways["solve of a stiffer body"] = lambda f: model.solve(f, young_modulus=stiff)
    return ways


def arrays_of(result: Any) -> list[np.ndarray]:
    """All arrays of a result: of a tuple, of attributes of a data class, of a mapping."""
    if isinstance(result, torch.Tensor):
        result = result.numpy()
    if isinstance(result, np.ndarray):
        return [result]
    if isinstance(result, dict):
        result = list(result.values())
    if isinstance(result, tuple | list):
        return [array for part in result for array in arrays_of(part)]
    if is_dataclass(result) and not isinstance(result, type):
        names = [
            field.name for field in fields(result) if field.name not in ("geometry", "seconds")
        ]
        return [array for name in names for array in arrays_of(getattr(result, name, None))]
    return []
