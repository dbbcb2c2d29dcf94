"""Put the results of all steps into one small file, and weights of runs into files of 16 MiB.

    python3 -m experiments gpu archive OUT FOLDER [--weights RUN …]

`results.tar.gz` has everything in OUT but datasets and tensors. The weights of a run are split into
RUN.safetensors.00, .01, …; `cat` joins them.
"""

from __future__ import annotations

import tarfile
from collections.abc import Sequence
from pathlib import Path

from shared_schema.common import InputError, WorkError

LIMIT = 16 * 2**20  # bytes of a file
LEFT_OUT = {".safetensors", ".h5"}


def archive(out: Path, folder: Path, weights: Sequence[str]) -> list[Path]:
    """Write the files; return their paths."""
    if not out.is_dir():
        raise InputError(f"'{out}': expected the folder of the results")
    folder.mkdir(parents=True, exist_ok=True)
    results = folder / "results.tar.gz"
    with tarfile.open(results, "w:gz") as tar:
        for path in sorted(out.rglob("*")):
            if path.is_file() and path.suffix not in LEFT_OUT and folder not in path.parents:
                tar.add(path, path.relative_to(out))
    if results.stat().st_size > LIMIT:
        raise WorkError(f"{results}: more than {LIMIT} bytes")
    return [results, *(part for name in weights for part in split(out, folder, name))]


def split(out: Path, folder: Path, name: str) -> list[Path]:
    """Split the weights of one run."""
    model = out / "runs" / name / "model.safetensors"
    if not model.is_file():
        raise InputError(f"--weights '{name}': no {model}")
    content, parts = model.read_bytes(), []
    for number, start in enumerate(range(0, len(content), LIMIT)):
        parts.append(folder / f"{name}.safetensors.{number:02d}")
        parts[-1].write_bytes(content[start : start + LIMIT])
    return parts
