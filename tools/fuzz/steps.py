"""Several commands of an attack in one folder, and the fields that they write."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tools.fuzz.attacks import Outcome, judged, outcome
from tools.fuzz.material import Material

LIMIT = 300.0  # seconds of a command


class Steps:
    """Commands executed in one folder, up to the first that is a finding or does not succeed.

    Parameters
    ----------
    material : Material
    folder : Path
    """

    def __init__(self, material: Material, folder: Path) -> None:
        folder.mkdir()
        self.material, self.folder = material, folder
        self.answer: dict[str, Any] = {}
        self.finding = ""

    def take(self, program: str, *words: str, codes: Sequence[int] = (0,)) -> bool:
        """Execute a command; True if it ends with one of the codes."""
        worker = self.material.workers[program]
        self.answer = worker.execute(list(words), self.folder, limit=LIMIT)
        self.finding = judged(self.answer)
        if not self.finding and self.answer["code"] not in codes:
            self.finding = f"{program} {words[0]}: exit {self.answer['code']}"
        return not self.finding

    def field(self, file: str, name: str = "displacement") -> np.ndarray:
        """Return a field of a solution file."""
        with np.load(self.folder / file) as arrays:
            return np.asarray(arrays[name])

    def ended(self, command: str, change: str, finding: str = "") -> Outcome:
        """Outcome of the attack, with what was found last."""
        return outcome(command, change, self.answer, self.finding or finding)


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference of two displacements, as a part of the largest component."""
    return float(np.abs(one - other).max() / max(float(np.abs(other).max()), 1e-300))
