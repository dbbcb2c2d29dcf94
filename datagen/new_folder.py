"""Seeing that a folder may be written to: new, or holding what the same step made before."""

from __future__ import annotations

from pathlib import Path

from shared_schema.errors import InputError
from shared_schema.manifest import MANIFEST, Manifest, read_manifest


def require_free(folder: Path, made: Manifest) -> None:
    """Take a folder for a dataset, dropping the manifest of what is made again.

    Parameters
    ----------
    folder : Path
        Need not exist.
    made : Manifest
        Of the dataset that shall be written; its shards need not be known yet.

    Raises
    ------
    InputError
        If the folder holds another dataset, or anything else.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out '{folder}': expected a folder, found a file")
    if (folder / MANIFEST).is_file():
        old = read_manifest(folder)
        theirs = (old.kind, old.case_digest, old.transforms)
        if theirs != (made.kind, made.case_digest, made.transforms):
            raise InputError(f"--out '{folder}': holds another dataset, '{old.name}'")
        (folder / MANIFEST).unlink()
    elif folder.is_dir() and any(not p.name.startswith("shard-") for p in folder.iterdir()):
        raise InputError(f"--out '{folder}': the folder holds something else")
