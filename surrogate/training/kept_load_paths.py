"""Load paths of the training samples, computed once and kept beside the dataset.

They are in ``load_paths/`` in the folder of the dataset, 100 samples a file. A killed computation
is resumed with the next file. The changes of the loads depend on the row of a sample and on the
number of paths only, so that all trainings share the files.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from shared_schema.common.memory import require_memory
from shared_schema.common.progress import Progress
from surrogate.data.dataset import Dataset
from surrogate.data.elements_of_case import require_linear_elements
from surrogate.data.sample_paths import SamplePaths
from surrogate.mechanics.load_path import follow, neighbours, random_changes
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.runs.tensor_file import Tensors, load_tensors, save_atomically
from surrogate.seeds import PATHS, stream

FOLDER = "load_paths"
IN_A_FILE = 100  # samples
FIELDS = ("change", "first", "second")
SIZE = 0.5  # standard deviation of the changes, relative to that of the forces


def require_path_memory(dataset: Dataset, count: int, samples: int, key: str) -> None:
    """Raise InputError if the load paths of some samples take more memory than there is.

    Parameters
    ----------
    dataset : Dataset
    count : int
        Number of paths K of each sample.
    samples : int
    key : str
        Configuration key that asks for them.
    """
    values = count * dataset.geometry.dimension * int(np.prod(dataset.geometry.grid.shape))
    needed = len(FIELDS) * 4 * values * samples
    require_memory(needed, f"{key} = {count}: the paths of {samples} samples")


def read_paths(dataset: Dataset, rows: Tensor, count: int) -> SamplePaths:
    """Read the load paths of some training samples.

    Parameters
    ----------
    dataset : Dataset
    rows : Tensor of int, (N,)
        Rows of the samples in the training split, ascending.
    count : int
        Number of paths K of each sample.

    Raises
    ------
    InputError
        If a file is damaged.
    """
    grid = dataset.geometry.grid
    fields: dict[str, list[Tensor]] = {name: [] for name in FIELDS}
    for number in files_of(rows):
        tensors, _ = load_tensors(path_file(dataset, number, count))
        chosen = rows[rows // IN_A_FILE == number] - number * IN_A_FILE
        for name in FIELDS:
            to_grid = grid.forces_to_grid if name == "change" else grid.to_grid
            fields[name].append(torch.from_numpy(to_grid(tensors[name][chosen].numpy())))
    return SamplePaths(*(torch.cat(fields[name]) for name in FIELDS))


def files_of(rows: Tensor) -> list[int]:
    """Numbers of the files that some rows are in."""
    numbers: list[int] = torch.unique(rows // IN_A_FILE).tolist()
    return numbers


def path_file(dataset: Dataset, number: int, count: int) -> Path:
    """Return the name of a file, which tells the dataset and the number of paths."""
    folder = dataset.train_on_disk.reader.folder / FOLDER
    return folder / f"{dataset.manifest.digest[:12]}-{count}-{number:05d}.safetensors"


def compute_missing(dataset: Dataset, rows: Tensor, count: int) -> None:
    """Compute the load paths of all files of some rows that are not there; OSError if it cannot.

    Raises
    ------
    InputError
        If the elements of the case are not linear.
    """
    require_linear_elements(dataset.manifest.case, "load paths")
    missing = [n for n in files_of(rows) if not path_file(dataset, n, count).is_file()]
    if not missing:
        return
    equilibrium = Equilibrium(dataset.geometry, dataset.material)
    beside = neighbours(dataset.geometry)
    size = SIZE * max(dataset.info.force.max_abs) / 3**0.5
    total = len(dataset.training)
    progress = Progress(len(missing) * IN_A_FILE, 0, "samples", "surrogate train: load paths")
    for done, number in enumerate(missing):
        of_file = torch.arange(number * IN_A_FILE, min((number + 1) * IN_A_FILE, total))
        samples = dataset.nodal_train(of_file)
        found: dict[str, list[Tensor]] = {name: [] for name in FIELDS}
        for place, row in enumerate(of_file.tolist()):
            u, f = samples.displacement[place], samples.force[place]
            generator = np.random.default_rng(stream(PATHS, count, row))
            change = random_changes(f, beside, size, count, generator)
            paths = follow(equilibrium, u, f, change)
            for name in FIELDS:
                found[name].append(torch.from_numpy(getattr(paths, name)).float())
            progress.update(done * IN_A_FILE + place + 1)
        tensors: Tensors = {name: torch.stack(found[name]) for name in FIELDS}
        save_atomically(tensors, path_file(dataset, number, count))
    progress.close("done")
