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
from typing import NamedTuple

import torch

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.command_line import laid_out
from shared_schema.common.configuration import shipped_files
from shared_schema.common.errors import InputError, nearest
from shared_schema.common.files import require_writable
from surrogate.learning.models.kinds import run_config
from surrogate.learning.runs.config_reader import SHIPPED, named
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.seal import Seal
from surrogate.mechanics.body.elements_of_case import require_known_elements
from surrogate.mechanics.body.geometry import PREFIX

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
    inside = sorted(str(file.parent) for file in folder.glob("*/config.yaml"))
    close = f"; did you mean '{inside[0]}'?" if inside else nearest(str(run), names)
    raise InputError(
        f"{run}: no run there, expected a folder with config.yaml, or a network of the package "
        f"({', '.join(names)}){close}"
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


class Row(NamedTuple):
    """A network; the fields are the columns."""

    name: str
    network: str
    body: str
    nodes: str
    parameters: str
    error: str
    tip: str
    size: str
    certificates: str


HEAD = Row(*Row._fields)


def row_of(name: str) -> Row:
    """Describe a network: errors are those of its test split, mean ē and median at the tip."""
    run = RunFolder(find_run(name))
    description, evaluation = run.description(), run.read_evaluation()
    config, unit = description.run, description.data.units.length
    coordinates = run.read_tensors()[PREFIX + "coordinates"]
    extent = coordinates.amax(dim=0) - coordinates.amin(dim=0)
    test = evaluation["test"]
    return Row(
        name,
        f"{config.architecture}; {config.likelihood.replace('_', ' ')}",
        " × ".join(f"{length:.3g}" for length in extent.tolist()) + f" {unit}",
        str(len(coordinates)),
        f"{evaluation['trainable_parameters'] / 1e6:.2f} M",
        f"{test['mean_error']:.2e} {unit}",
        f"{test['relative_tip_error_median']:.2%}",
        f"{size_of(run.folder) / 1e6:.1f} MB",
        certificates_of(run),
    )


def certificates_of(run: RunFolder) -> str:
    """Say what `surrogate predict --certify` has for a run: "full, fast", "full" or "none"."""
    data = run.description().data
    try:
        require_known_elements(data.case)
        data.material  # noqa: B018
    except InputError:
        return "none"
    return "full, fast" if run.fast_certificate.is_file() else "full"


def trained_list() -> str:
    """Lay out the table, one line a network."""
    rows = [HEAD, *map(row_of, shelved())]
    return laid_out(rows)


def config_list() -> str:
    """Lay out name, architecture and one line of every recipe."""
    rows = [("configuration", "model", "")]
    for name, content, line in shipped_files(SHIPPED):
        config = run_config(named(content, "CASE", name), name)
        rows.append((name, config.architecture, line))
    return laid_out(rows)
