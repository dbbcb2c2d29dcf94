"""Add noise to the displacements of a dataset, as in the paper's section on noisy data.

Where ‖f‖₂ ≤ threshold, u → (1 + γ) u with one γ ~ U(−relative, relative) a sample.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.transforms.written_dataset import claim_folder, locked, remove_other_shards
from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import InputError
from shared_schema.common.progress import Progress
from shared_schema.common.units import LARGEST_SEED, Units
from shared_schema.dataset_reader import DatasetReader
from shared_schema.layout import Arrays
from shared_schema.manifest import Manifest, write_manifest
from shared_schema.shard import write_shard
from shared_schema.stiffness import read_stiffness, write_stiffness

RELATIVE, THRESHOLD = 0.2, 0.7  # the paper's: within 20 %, up to 0.7 N


@checked_arguments
def add_noise(
    nodal: Path | str,
    out: Path | str,
    *,
    seed: int = 0,
    relative: float = RELATIVE,
    threshold: float = THRESHOLD,
) -> Manifest:
    """Copy a nodal dataset with noise on its displacements.

    Parameters
    ----------
    nodal : Path or str
        Nodal dataset.
    out : Path or str
        Folder of the noisy dataset.
    seed : int
        Seed of γ, together with the sample number.
    relative : float
        Largest |γ|.
    threshold : float
        Largest ‖f‖₂ of a sample that gets noise, in N.

    Raises
    ------
    InputError
        If the source is not an intact nodal dataset, a number is out of range, or the folder
        holds something else.
    """
    if not 0 < relative < 1:
        raise InputError(f"--relative {relative}: expected a number between 0 and 1")
    if not 0 < threshold < math.inf:
        raise InputError(f"--threshold {threshold}: expected a positive number of newtons")
    if not 0 <= seed <= LARGEST_SEED:
        raise InputError(f"--seed {seed}: expected a number from 0 to {LARGEST_SEED}")
    folder, reader = Path(out), DatasetReader(Path(nodal), "nodal")
    reader.require_equilibria()
    manifest = reader.manifest
    step: dict[str, Any] = {
        "name": "noise",
        "relative": relative,
        "threshold": threshold,
        "seed": seed,
        "source_digest": manifest.digest,
    }
    noisy = manifest.model_copy(update={"transforms": (*manifest.transforms, step)})
    with locked(folder):
        return _make(reader, folder, noisy, step)


def _make(reader: DatasetReader, folder: Path, noisy: Manifest, step: dict[str, Any]) -> Manifest:
    """Write the noisy dataset into its locked folder."""
    manifest = reader.manifest
    settings = step["seed"], step["relative"], step["threshold"]
    claim_folder(folder, noisy)
    progress = Progress(manifest.samples, 0, "samples", f"datagen noise {manifest.name}")
    entries, done, units = [], 0, Units.of_case(manifest.case)
    for entry, arrays in reader:
        factor = noise_factor(arrays, *settings)
        arrays["samples/displacement"] = arrays["samples/displacement"] * factor[:, None, None]
        path, case_digest = folder / entry.file, manifest.case_digest
        digest = write_shard(path, "nodal", arrays, case_digest, reader.cell_type, units)
        entries.append(entry.model_copy(update={"sha256": digest}))
        done += entry.samples
        progress.update(done)
    progress.close()
    update: dict[str, Any] = {"shards": tuple(entries)}
    if manifest.stiffness is not None:
        stiffness = read_stiffness(reader.folder)
        update["stiffness"] = write_stiffness(
            folder, stiffness, manifest.case_digest, reader.cell_type, units
        )
    remove_other_shards(folder, entries)
    return write_manifest(folder, noisy.model_copy(update=update))


def noise_factor(
    arrays: Arrays, seed: int, relative: float, threshold: float
) -> NDArray[np.float64]:
    """1 + γ of every sample of a nodal shard, 1 where the force is above the threshold: (N,)."""
    gamma = np.array(
        [
            np.random.default_rng([seed, number]).uniform(-relative, relative)
            for number in arrays["samples/number"].tolist()
        ]
    )
    small = np.linalg.norm(arrays["samples/force"], axis=(1, 2)) <= threshold
    return np.where(small, 1.0 + gamma, 1.0)
