"""Trained networks that come with the package: small run folders, found by their names.

A run folder has the files of `KEPT`: what prediction, export, report and `surrogate list` read. It
has no checkpoint, metrics or figures. A network that would be too large has its large matrices in
half precision (11 significant bits), as those of the modes of a reduced network of a body in space.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import torch

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import InputError
from shared_schema.common.files import require_writable
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.seal import Seal

SHELF = Path(__file__).parents[2] / "trained"
KEPT = ("config.yaml", "model.safetensors", "evaluation.json", "hardware.txt")
KEPT_IF_THERE = (
    "intervals.safetensors",
    "fast_certificate.safetensors",
    "modal_cubature.safetensors",
)
LARGEST = 5_000_000  # bytes of one network
LARGEST_SHELF = 16_000_000  # bytes of all networks
LARGE_MATRIX = 100_000  # entries from which on it may be in half precision


def shelved() -> list[str]:
    """Names of the networks that come with the package, sorted."""
    return sorted(config.parent.name for config in SHELF.glob("*/config.yaml"))


def find_run(run: str | Path) -> Path:
    """Return the folder of a run, given its path or the name of a network of the package.

    A run folder in that place goes first, so that a user's own runs may have any name.

    Raises
    ------
    InputError
        If there is neither.
    """
    folder = Path(run)
    if (folder / "config.yaml").is_file():
        return folder
    names = shelved()
    if str(run) in names:
        return SHELF / str(run)
    raise InputError(
        f"{run}: no run there, expected a folder with config.yaml, or a network of the package "
        f"({', '.join(names)})"
    )


def is_shelved(folder: Path) -> bool:
    """True for the folder of a network that comes with the package."""
    return folder.parent.resolve() == SHELF.resolve()


def require_changeable(run: Path, copy: Path | None) -> None:
    """Require that results can be written into a run, or into a new folder for a copy of it.

    Raises
    ------
    InputError
        If the copy's folder exists, or there is none for a network that comes with the package.
    """
    folder = find_run(run)
    if copy is not None:
        if copy.exists():
            raise InputError(f"out '{copy}': exists, expected a new folder", "out")
        require_writable(copy)
    elif is_shelved(folder):
        raise InputError(
            f"{folder.name}: comes with the package and is not changed; expected --out DIR, "
            "a new folder for a copy with the results"
        )
    else:
        require_writable(folder, "RUN")


@checked_arguments
def shelve(run: str | Path, name: str) -> Path:
    """Put a trained and evaluated run among the networks of the package, or replace one.

    Parameters
    ----------
    run : str or Path
        Run folder.
    name : str
        Name by which commands and `surrogate.load` find it.

    Returns
    -------
    Path
        Folder of the network.

    Raises
    ------
    InputError
        If the run is not finished or not evaluated on its own dataset, the name is not a plain one,
        or the files are too large.
    """
    if not name.isidentifier():
        raise InputError(f"NAME '{name}': expected letters, digits and underscores")
    source = RunFolder(Path(run))
    source.description()
    source.read_tensors()
    if not source.read_evaluation().get("trained_on_this_data"):
        raise InputError(f"{run}: evaluated on another dataset, expected that of its training")
    others = sum(size_of(SHELF / other) for other in shelved() if other != name)
    with _copied(Path(run), SHELF / name) as copy:
        if size_of(copy) > LARGEST:
            _halve_large_matrices(RunFolder(copy))
        size = size_of(copy)
        for what, found, limit in (
            (f"{run}", size, LARGEST),
            ("all networks of the package", others + size, LARGEST_SHELF),
        ):
            if found > limit:
                found_mb, limit_mb = found / 1e6, limit / 1e6
                raise InputError(f"{what}: {found_mb:.1f} MB, expected {limit_mb:.0f} at most")
    return SHELF / name


def _halve_large_matrices(run: RunFolder) -> None:
    """Write the large matrices of a run in half precision; networks are loaded in float32."""
    tensors = run.read_tensors()
    large = {name for name, value in tensors.items() if value.numel() >= LARGE_MATRIX}
    halved = {name for name in large if tensors[name].dtype == torch.float32}
    run.write_tensors({n: value.half() if n in halved else value for n, value in tensors.items()})


def copy_run(run: Path, folder: Path) -> Path:
    """Copy the files of a run that are kept to a new folder, and return it."""
    with _copied(run, folder):
        return folder


@contextmanager
def _copied(run: Path, folder: Path) -> Iterator[Path]:
    """Yield a copy of the files that are kept; it then takes the place of `folder`."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent) as parts:
        copy = Path(parts) / folder.name
        copy.mkdir()
        for name in (*KEPT, *KEPT_IF_THERE):
            if (run / name).is_file():
                shutil.copy(run / name, copy)
        Seal(copy).make(*(file for file in copy.iterdir()))
        yield copy
        if folder.exists():
            folder.rename(Path(parts) / "replaced")
        copy.rename(folder)


def size_of(folder: Path) -> int:
    """Return the bytes of all files of a folder."""
    return sum(file.stat().st_size for file in folder.iterdir())
