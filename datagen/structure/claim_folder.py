"""Claim a folder for the dataset of a step: a new one, or one that the same step wrote before."""

from __future__ import annotations

from pathlib import Path

from shared_schema.common.atomic_file import PARTIAL, remove_partial_files, require_writable
from shared_schema.common.errors import InputError
from shared_schema.manifest import MANIFEST, Manifest, read_manifest
from shared_schema.stiffness import STIFFNESS_FILE


def claim_folder(folder: Path, made: Manifest) -> None:
    """Claim a folder for a dataset; remove the manifest and stiffness of the same one, if there.

    Parameters
    ----------
    folder : Path
        Need not exist.
    made : Manifest
        Manifest of the dataset that will be written; its shards need not be known yet.

    Raises
    ------
    InputError
        If the folder holds another dataset, or anything else, or cannot be written to.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out '{folder}': expected a folder, found a file")
    require_writable(folder)
    if (folder / MANIFEST).is_file():
        old = read_manifest(folder)
        theirs = (old.kind, old.case_digest, old.transforms)
        if theirs != (made.kind, made.case_digest, made.transforms):
            raise InputError(f"--out '{folder}': holds another dataset, '{old.name}'")
        (folder / MANIFEST).unlink()
    elif folder.is_dir():
        ours = ("shard-", STIFFNESS_FILE, PARTIAL)  # of a step that was killed
        if not all(path.name.startswith(ours) for path in folder.iterdir()):
            raise InputError(f"--out '{folder}': the folder holds something else")
    (folder / STIFFNESS_FILE).unlink(missing_ok=True)
    remove_partial_files(folder)
