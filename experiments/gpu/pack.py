"""Make the folder that is carried to the machine with the GPU: wheels and datasets.

    python -m experiments gpu pack build/gpu --data data

The 2D datasets are copied whole; those in space are rounded and packed
(`experiments.gpu.carried_dataset`), with as many samples as there are, or as ``--samples`` says.
Given runs are packed, with the prediction of one load by the CPU (`experiments.gpu.frames`).
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Sequence
from pathlib import Path

from experiments.framework.machine import ROOT
from experiments.gpu.carried_dataset import SUFFIX, pack
from experiments.gpu.frames import PACKED, write_reference
from experiments.gpu.responses import REFERENCES, write_references
from experiments.gpu.setting import CASES
from shared_schema.common import InputError, WorkError
from surrogate.learning.runs import RunFolder, find_run

LIMIT = 64 * 2**20  # bytes of the carried folder and the repository
WITH_NEEDS = ("pydantic",)  # its core has to be of one exact version
ALONE = ("h5py", "jinja2", "markupsafe", "pyyaml", "safetensors", "tqdm")  # need NumPy at most
PLATFORMS = (
    "manylinux_2_28_x86_64",
    "manylinux_2_27_x86_64",
    "manylinux_2_17_x86_64",
    "manylinux2014_x86_64",
)


def download_wheels(folder: Path) -> None:
    """Download wheels for Python 3.12 on x86-64 Linux."""
    platforms = [word for name in PLATFORMS for word in ("--platform", name)]
    for names in (WITH_NEEDS, ("--no-deps", *ALONE)):
        done = subprocess.run(
            [
                *(sys.executable, "-m", "pip", "download", "--quiet", "--only-binary=:all:"),
                *("--python-version", "3.12", "--implementation", "cp", *platforms),
                *("--dest", str(folder), *names),
            ]
        )
        if done.returncode:
            raise WorkError("pip download failed")


def pack_datasets(data: Path, folder: Path, samples: int | None) -> list[str]:
    """Copy the datasets in the plane, pack those in space; return a line about each."""
    lines = []
    folder.mkdir(parents=True, exist_ok=True)
    for case in CASES:
        source, packed = data / case / "structured", folder / f"{case}{SUFFIX}"
        if not (source / "manifest.json").is_file():
            raise InputError(f"--data '{data}': no complete dataset '{case}/structured' in it")
        if case.endswith("3d"):
            lines.append(f"{case}: {pack(source, packed, samples)} samples")
        else:
            shutil.rmtree(folder / case, ignore_errors=True)
            shutil.copytree(source, folder / case / "structured")
            lines.append(f"{case}: all samples")
    return lines


def pack_run(run: Path, folder: Path) -> str:
    """Pack what predictions need of a run, or of one that comes with the package."""
    source = RunFolder(find_run(run))
    name = "-".join(run.parts[-2:])
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as aside:
        write_reference(source.folder, Path(aside))
        with tarfile.open(folder / f"{name}{PACKED}", "w:xz") as tar:
            for path in (*source.folder.iterdir(), *Path(aside).iterdir()):
                if path.is_file() and path != source.columns:  # which a GPU does not need
                    tar.add(path, path.name)
    return f"{name}: run"


def bytes_of(folder: Path) -> int:
    """Size of all files below a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def bytes_of_repository() -> int:
    """Size of the files under version control."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    paths = (ROOT / name for name in listed.stdout.split("\0") if name)
    return sum(path.stat().st_size for path in paths if path.is_file())


def make(folder: Path, data: Path, samples: int | None, runs: Sequence[Path], wheels: bool) -> None:
    """Fill the folder, and say what is in it and how large it is."""
    lines = pack_datasets(data, folder / "data", samples)
    write_references(folder / REFERENCES)
    lines += [pack_run(run, folder / "runs") for run in runs]
    if wheels:
        download_wheels(folder / "wheels")
    carried, repository = bytes_of(folder), bytes_of_repository()
    lines.append(
        f"{carried / 2**20:.1f} MiB, and {repository / 2**20:.1f} MiB of repository, "
        f"of {LIMIT / 2**20:.0f} MiB"
    )
    print("\n".join(lines))
    if carried + repository > LIMIT:
        raise WorkError("too large; expected fewer --samples")
