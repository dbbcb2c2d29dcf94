"""Script: write the samples of PLAID's 2D_MultiScHypEl as files of unit cells.

It runs in an environment with pyplaid, and imports nothing of this project::

    python read_plaid.py PLAID FOLDER

FOLDER gets an ``.npz`` file (see `experiments.unit_cells.unit_cell`) of every sample of PLAID whose
solution is there: the organisers keep those of the test split. What does not fit is printed, with
exit code 3.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from plaid import Sample
from plaid.storage import init_from_disk

UNFIT = 3
FIELDS = ("u1", "u2", "P11", "P12", "P22", "P21", "psi")
GLOBALS = ("C11", "C12", "C22", "effective_energy")


def is_solved(sample: Sample) -> bool:
    """True if all fields and the energy are there."""
    values = [sample.get_field(name) for name in FIELDS]
    values += [sample.get_global(name) for name in GLOBALS if name in sample.get_global_names()]
    return len(values) == len(FIELDS) + len(GLOBALS) and all(
        value is not None and np.isfinite(value).all() for value in values
    )


def main(source: Path, folder: Path) -> None:
    """Write all solved samples."""
    folder.mkdir(parents=True, exist_ok=True)
    datasets, converters = init_from_disk(source)
    written = 0
    for split in sorted(datasets, reverse=True):  # train before test
        for row in range(len(datasets[split])):
            sample = converters[split].to_plaid(datasets[split], row)
            if not is_solved(sample):
                continue
            elements = sample.get_elements()
            if list(elements) != ["TRI_3"]:
                print(f"{source}: elements {', '.join(elements)}, expected TRI_3")
                sys.exit(UNFIT)
            *stretch, energy = (float(np.ravel(sample.get_global(name))[0]) for name in GLOBALS)
            np.savez(
                folder / f"{written:05d}.npz",
                coordinates=sample.get_nodes()[:, :2].astype(np.float64),
                triangles=elements["TRI_3"].astype(np.int64),
                stretch=np.array(stretch),
                fields=np.column_stack([sample.get_field(name) for name in FIELDS]),
                energy=np.array(energy),
            )
            written += 1
    if not written:
        print(f"{source}: no sample with {', '.join((*FIELDS, *GLOBALS))}")
        sys.exit(UNFIT)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
