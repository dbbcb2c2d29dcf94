"""What every step that writes a dataset does: it claims a folder, and says statistics and versions.

The folder is a new one, or one that the same step wrote before.
"""

from __future__ import annotations

import platform
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen import __version__
from shared_schema.common.errors import InputError
from shared_schema.common.files import PARTIAL, remove_partial_files, require_writable
from shared_schema.common.folder_lock import LOCK, FolderLock
from shared_schema.manifest import (
    MANIFEST,
    ComponentStatistics,
    Manifest,
    ShardEntry,
    read_manifest,
)
from shared_schema.stiffness import STIFFNESS_FILE


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Context in which this step alone works in the folder of its dataset, which need not exist.

    Raises
    ------
    InputError
        If another process works in the folder, it is a file, or it cannot be written to.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out '{folder}': expected a folder, found a file")
    require_writable(folder)
    with FolderLock(folder):
        yield


def _is_same(old: Manifest, made: Manifest) -> bool:
    theirs = old.kind, old.case_digest, old.transforms
    return theirs == (made.kind, made.case_digest, made.transforms)


def _is_smaller(old: Manifest, made: Manifest) -> bool:
    """True if the old dataset was made in the same way before the case's dataset has grown."""
    grown = old.case_digest in {stage.case_digest for stage in made.history}
    theirs = [{**step, "source_digest": None} for step in old.transforms]
    ours = [{**step, "source_digest": None} for step in made.transforms]
    return grown and old.kind == made.kind and theirs == ours


def claim_folder(folder: Path, made: Manifest) -> None:
    """Claim a locked folder for a dataset; remove manifest and stiffness of the same one, if there.

    Parameters
    ----------
    folder : Path
    made : Manifest
        Manifest of the dataset that will be written; its shards need not be known yet. It may
        replace the same dataset with fewer samples.

    Raises
    ------
    InputError
        If the folder holds another dataset, or anything else.
    """
    if (folder / MANIFEST).is_file():
        old = read_manifest(folder)
        if not (_is_same(old, made) or _is_smaller(old, made)):
            raise InputError(
                f"--out '{folder}': holds another dataset, '{old.name}'; expected another folder, "
                "or that it is deleted"
            )
        (folder / MANIFEST).unlink()
    else:
        ours = ("shard-", STIFFNESS_FILE, PARTIAL, LOCK)  # of a step that was killed
        if not all(path.name.startswith(ours) for path in folder.iterdir()):
            raise InputError(f"--out '{folder}': the folder holds something else")
    (folder / STIFFNESS_FILE).unlink(missing_ok=True)
    remove_partial_files(folder)


def remove_other_shards(folder: Path, entries: Iterable[ShardEntry]) -> None:
    """Remove the shards that a killed step left behind and that the dataset does not list."""
    listed = {entry.file for entry in entries}
    for path in folder.glob("shard-*"):
        if path.name not in listed:
            path.unlink()


class RunningStatistics:
    """Mean, standard deviation and largest magnitude of each component, shard by shard."""

    def __init__(self) -> None:
        self._count = 0
        self._sum: Any = 0.0
        self._squares: Any = 0.0
        self._max: Any = 0.0

    def add(self, values: NDArray[np.float32]) -> None:
        """Add values of shape (N, d, n_nodes)."""
        if values.size == 0:
            return
        exact = values.astype(np.float64)
        self._count += exact.shape[0] * exact.shape[2]
        self._sum = self._sum + exact.sum(axis=(0, 2))
        self._squares = self._squares + (exact**2).sum(axis=(0, 2))
        self._max = np.maximum(self._max, np.abs(exact).max(axis=(0, 2)))

    def result(self) -> ComponentStatistics:
        """Statistics of all values so far."""
        mean = self._sum / self._count
        std = np.sqrt(np.maximum(self._squares / self._count - mean**2, 0.0))
        return ComponentStatistics(
            mean=tuple(mean.tolist()), std=tuple(std.tolist()), max_abs=tuple(self._max.tolist())
        )


def software_versions(solved: bool = True) -> dict[str, str]:
    """Versions by name of software, as the manifest stores them; solvers only if they were used."""
    import h5py
    import numpy as np

    return {
        "datagen": __version__,
        "python": platform.python_version(),
        **(_solvers() if solved else {}),
        **_gmsh(),
        "h5py": h5py.__version__,
        "numpy": np.__version__,
    }


def _gmsh() -> dict[str, str]:
    """Version of gmsh, if it is there: a mesh need not be its."""
    try:
        import gmsh
    except (ImportError, OSError):
        return {}
    return {"gmsh": gmsh.GMSH_API_VERSION}


def _solvers() -> dict[str, str]:
    import dolfinx
    from petsc4py import PETSc

    return {
        "dolfinx": dolfinx.__version__,
        "petsc": ".".join(str(part) for part in PETSc.Sys.getVersion()),
    }
