"""Record of a run's finished work; the run can be killed and resumed at any time.

During a run its folder holds ``.journal/``: the case, an entry for each finished shard, and the
solved parts of unfinished ones. A shard is finished if its entry exists and its file has the
entry's checksum. After the last shard the stiffness and the manifest are written and the journal is
removed; a later start takes the entries from the manifest.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from datagen.cases.case import Case
from shared_schema.common.atomic_file import remove_partial_files, require_writable, write_text
from shared_schema.common.checksum import sha256
from shared_schema.common.configuration import validate
from shared_schema.common.errors import InputError
from shared_schema.layout import Arrays
from shared_schema.manifest import MANIFEST, Manifest, ShardEntry, digest_of, read_manifest
from shared_schema.shard_reader import read_attributes, read_shard
from shared_schema.shard_writer import write_shard
from shared_schema.stiffness import STIFFNESS_FILE

JOURNAL = ".journal"
LOCK_WAIT = 3.0  # seconds that the ranks of a killed run may take to end


class Journal:
    """The state of a run in its folder.

    Parameters
    ----------
    folder : Path
        Folder of the dataset; created if it does not exist.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._journal = folder / JOURNAL
        self._lock: int | None = None

    @property
    def is_new(self) -> bool:
        """True if no run has begun in the folder; InputError if the folder cannot be written to."""
        require_writable(self.folder)
        return not (self._journal.exists() or (self.folder / MANIFEST).exists())

    def open(self, case: Case) -> None:
        """Lock the folder for this run and check that its content belongs to `case`.

        Raises
        ------
        InputError
            If another run works in the folder, or it holds another case, or other files.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError(f"--out '{self.folder}': expected a folder, found a file")
        self.folder.mkdir(parents=True, exist_ok=True)
        self._lock = _locked(self.folder)
        try:
            found = self._case_found()
            if found is not None:
                _require_same(self.folder, found, case.plain())
            elif any(self.folder.iterdir()) and not self._journal.exists():
                raise InputError(f"--out '{self.folder}': the folder holds something else")
            else:
                self._require_shards_of(case)
            self._journal.mkdir(exist_ok=True)
            for folder in (self.folder, self._journal):
                remove_partial_files(folder)
            if found is None:
                text = json.dumps(case.plain(), indent=1) + "\n"
                write_text(self._journal / "case.json", text)
        except BaseException:
            self.close()
            raise

    def _case_found(self) -> dict[str, Any] | None:
        """Case of the folder, from the journal or the manifest; None if neither can be read."""
        content = _json(self._journal / "case.json")
        if isinstance(content, dict):
            return content
        if (self.folder / MANIFEST).is_file():
            return read_manifest(self.folder, "nodal").case
        return None

    def _require_shards_of(self, case: Case) -> None:
        """Raise InputError unless every shard and part is of this case."""
        kept = [self.folder / name for name in self.entries()]
        kept += [part for part in sorted(self._journal.glob("part-*.h5")) if _is_intact(part)]
        for path in kept:
            if read_attributes(path, "nodal")["case_digest"] != case.digest():
                raise InputError(
                    f"--out '{self.folder}': {path.name} is made from another case "
                    f"({JOURNAL}/case.json, which should say it, cannot be read)"
                )

    def entries(self) -> dict[str, ShardEntry]:
        """Entries of the finished shards whose files are intact, by file name.

        An unreadable entry does not count: its shard is solved again.
        """
        entries = []
        if (self.folder / MANIFEST).is_file():
            entries += list(read_manifest(self.folder).shards)
        for path in sorted(self._journal.glob("shard-*.json")):
            with suppress(InputError):
                entries.append(validate(ShardEntry, _json(path), str(path)))
        return {
            entry.file: entry
            for entry in entries
            if (self.folder / entry.file).is_file()
            and sha256(self.folder / entry.file) == entry.sha256
        }

    def complete_manifest(self, shards: tuple[ShardEntry, ...]) -> Manifest | None:
        """Manifest of a complete dataset; None if shards or stiffness are not those it lists.

        Parameters
        ----------
        shards : tuple of ShardEntry
            All shards of the dataset, intact.
        """
        if not (self.folder / MANIFEST).is_file():
            return None
        manifest, path = read_manifest(self.folder), self.folder / STIFFNESS_FILE
        found = sha256(path) if path.is_file() else None
        if manifest.shards != shards or found != manifest.stiffness:
            return None
        return manifest

    def record(self, entry: ShardEntry) -> None:
        """Record a shard as finished; its file must be complete."""
        path = self._journal / f"{Path(entry.file).stem}.json"
        write_text(path, entry.model_dump_json() + "\n")

    def keep_part(self, shard: int, arrays: Arrays, case: Case, cell_type: str) -> None:
        """Write the solved part of an unfinished shard, and then its checksum."""
        first = min([*arrays["samples/number"], *arrays["failed/number"]])
        path = self._journal / f"part-{shard:05d}-{first:08d}.h5"
        digest = write_shard(path, "nodal", arrays, case.digest(), cell_type)
        write_text(path.with_suffix(".sha256"), digest)

    def parts(self, shard: int) -> list[Arrays]:
        """Read the intact parts of an unfinished shard."""
        return [
            read_shard(path, "nodal")
            for path in sorted(self._journal.glob(f"part-{shard:05d}-*.h5"))
            if _is_intact(path)
        ]

    def drop_parts(self, shard: int) -> None:
        """Remove the parts of a finished shard."""
        for path in self._journal.glob(f"part-{shard:05d}-*"):
            path.unlink(missing_ok=True)

    def remove(self) -> None:
        """Remove the journal of a complete dataset."""
        shutil.rmtree(self._journal, ignore_errors=True)

    def close(self) -> None:
        """Unlock the folder."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def _locked(folder: Path) -> int:
    """Lock a folder; raise InputError if another run holds the lock longer than `LOCK_WAIT`."""
    descriptor = os.open(folder, os.O_RDONLY)
    limit = time.monotonic() + LOCK_WAIT
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > limit:
                os.close(descriptor)
                raise InputError(f"--out '{folder}': another run is working in it") from None
            time.sleep(0.05)
        else:
            return descriptor


def _json(path: Path) -> Any:
    """Content of a JSON file; None if there is none, or none that can be read."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None


def _is_intact(part: Path) -> bool:
    """True if a part of a shard has the checksum that was written after it."""
    checksum = part.with_suffix(".sha256")
    return checksum.is_file() and checksum.read_bytes() == sha256(part).encode()


def _require_same(folder: Path, found: dict[str, Any], wanted: dict[str, Any]) -> None:
    if digest_of(found) == digest_of(wanted):
        return
    differences = [
        f"{key} = {new!r}, the folder has {old!r}"
        for key, (old, new) in _differences(found, wanted).items()
    ]
    raise InputError(f"--out '{folder}': made from another case: {'; '.join(differences)}")


def _differences(
    old: dict[str, Any], new: dict[str, Any], prefix: str = ""
) -> dict[str, tuple[Any, Any]]:
    found: dict[str, tuple[Any, Any]] = {}
    for key in sorted(old.keys() | new.keys()):
        a, b = old.get(key), new.get(key)
        if isinstance(a, dict) and isinstance(b, dict):
            found |= _differences(a, b, f"{prefix}{key}.")
        elif a != b:
            found[prefix + key] = (a, b)
    return found
