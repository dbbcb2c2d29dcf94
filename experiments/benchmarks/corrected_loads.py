"""Random loads, a network's predictions, and the equilibria that `correct` finds from them.

    .venv-surrogate/bin/python -m experiments.benchmarks.corrected_loads RUN COUNT FOLDER

writes FOLDER/load-00000.npz, …: force, predicted and corrected displacement, Newton iterations and
processor time. Files that are there are kept, so that a killed run resumes.
"""

from __future__ import annotations

import sys
import warnings
from functools import partial
from pathlib import Path

import numpy as np
import torch

import surrogate
from experiments.measures.corrections import corrected
from shared_schema.common import complete_or_absent
from surrogate.learning.inference import drawn_loads

SEED = 15


def file_of(folder: Path, number: int) -> Path:
    """File of a load case."""
    return folder / f"load-{number:05d}.npz"


def main(run: str, count: int, folder: Path) -> None:
    """Correct the missing load cases."""
    warnings.simplefilter("ignore", surrogate.OutsideTrainingWarning)
    torch.set_num_threads(1)
    model = surrogate.load(run)
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(count):
        path = file_of(folder, number)
        if path.is_file():
            continue
        force = drawn_loads(model, 1, np.random.default_rng([SEED, number]))[0]
        predicted = model.predict(force)
        found, seconds = corrected(partial(model.correct, force, predicted))
        with complete_or_absent(path) as unfinished, unfinished.open("wb") as file:
            np.savez_compressed(
                file,
                coordinates=model.geometry.coordinates,
                force=force,
                displacement=predicted,
                corrected=np.full_like(force, np.nan) if found is None else found.displacement,
                iterations=-1 if found is None else found.iterations,
                seconds=seconds,
            )


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
