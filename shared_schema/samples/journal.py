"""Record of a run's finished work; the run can be killed and resumed at any time.

During a run its folder holds ``.journal/``: the case, an entry for each finished shard, and the
solved parts of unfinished ones. A shard is finished if its entry exists and its file has the
entry's checksum. After the last shard the stiffness and the manifest are written and the journal is
removed; a later start takes the entries from the manifest.

A complete dataset can grow by further samples of the same case. Its manifest and shards stay what
they are until all samples are solved; only then its last shard, if it is not full, gets its further
samples, and the manifest is replaced.
"""

from __future__ import annotations

import json
import shutil
import signal
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Protocol

from shared_schema.common.configuration import difference_text, differences, validate
from shared_schema.common.errors import InputError
from shared_schema.common.files import remove_partial_files, require_writable, sha256, write_text
from shared_schema.common.folder_lock import LOCK, FolderLock
from shared_schema.common.units import Units
from shared_schema.layout import Arrays
from shared_schema.manifest import (
    JOURNAL,
    MANIFEST,
    Manifest,
    ShardEntry,
    Stage,
    digest_of,
    read_manifest,
)
from shared_schema.samples.dataset_settings import DatasetSettings, shard_name
from shared_schema.samples.results import merged
from shared_schema.shard import read_attributes, read_shard, write_shard
from shared_schema.stiffness import STIFFNESS_FILE

SIGNALS = (signal.SIGINT, signal.SIGTERM)
SAMPLES, PROGRAM = "dataset.samples", "program"
PROGRAMS = ("datagen run", "surrogate sample")  # which the software of a manifest names
FILES = (  # with their checksums
    ("mesh", "sha256", "path"),
    ("load", "family_sha256", "family"),
    ("material", "model_sha256", "model"),
)


class SampledCase(Protocol):
    """The case of a dataset, as far as its samples are concerned."""

    @property
    def dataset(self) -> DatasetSettings:
        """Number of samples and of shards."""

    @property
    def units(self) -> Units:
        """Labels of its units."""

    def plain(self) -> dict[str, Any]:
        """The whole configuration as plain data."""

    def digest(self) -> str:
        """SHA-256 of it."""


class Journal:
    """The state of a run in its folder.

    Parameters
    ----------
    folder : Path
        Folder of the dataset; created if it does not exist.
    case : SampledCase
    program : str
        Command that makes the samples. Another one does not go on with them.
    """

    def __init__(self, folder: Path, case: SampledCase, program: str) -> None:
        self.folder, self.case, self.program = folder, case, program
        self._journal = folder / JOURNAL
        self._lock = ExitStack()
        self._before: Manifest | None = None

    @property
    def rest(self) -> Path:
        """Folder for what is kept of unfinished samples; removed when all are finished."""
        return self._journal

    @property
    def is_new(self) -> bool:
        """True if no run has begun in the folder; InputError if the folder cannot be written to."""
        require_writable(self.folder)
        return not (self._journal.exists() or (self.folder / MANIFEST).exists())

    def open(self, require: Callable[[Path], None] = lambda path: None) -> None:
        """Lock the folder for this run and check that its content belongs to the case.

        Parameters
        ----------
        require : callable
            Raises InputError if further samples cannot go with those of a shard or part.

        Raises
        ------
        InputError
            If another run works in the folder, or it holds another case, or other files.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError(f"--out '{self.folder}': expected a folder, found a file")
        self._lock.enter_context(FolderLock(self.folder))
        try:
            self._claim(require)
        except BaseException:
            self.close()
            raise

    def _claim(self, require: Callable[[Path], None]) -> None:
        """Check the locked folder's content, and record the case in the journal."""
        manifest, wanted = self._manifest(), self.case.plain()
        if manifest is not None and manifest.case_digest != self.case.digest():
            self._before = manifest
        found = _json(self._journal / "case.json")
        is_recorded = isinstance(found, dict)
        if is_recorded:
            self._require_program(found.pop(PROGRAM, self.program))
            _require_same(self.folder, found, wanted)
        elif manifest is not None:
            _require_same_or_fewer(self.folder, manifest.case, wanted)
        elif not self._journal.exists() and any(p.name != LOCK for p in self.folder.iterdir()):
            raise InputError(f"--out '{self.folder}': the folder holds something else")
        if not is_recorded:
            self._require_shards_of_case()
        if manifest is None or self._before is not None:  # further samples are to be solved
            for path in self._kept():
                require(path)
        self._journal.mkdir(exist_ok=True)
        for folder in (self.folder, self._journal):
            remove_partial_files(folder)
        if not is_recorded:
            text = json.dumps({**wanted, PROGRAM: self.program}, indent=1) + "\n"
            write_text(self._journal / "case.json", text)

    def _require_program(self, maker: str) -> None:
        if maker != self.program:
            raise InputError(
                f"--out '{self.folder}': `{maker}` makes these samples, expected another folder "
                f"for those of `{self.program}`"
            )

    def _manifest(self) -> Manifest | None:
        """Manifest of a complete dataset in the folder; InputError if `run` did not make it."""
        if not (self.folder / MANIFEST).is_file():
            return None
        manifest = read_manifest(self.folder, "nodal")
        if manifest.transforms:
            steps = ", ".join(str(step.get("name")) for step in manifest.transforms)
            raise InputError(
                f"--out '{self.folder}': holds a dataset that was changed afterwards ({steps}), "
                f"expected one as `{self.program}` makes it"
            )
        makers = [name for name in PROGRAMS if name.partition(" ")[0] in manifest.software]
        self._require_program(makers[0] if makers else self.program)
        return manifest

    @property
    def history(self) -> tuple[Stage, ...]:
        """The dataset before each time that it has grown, this run's growth included."""
        if self._before is None:
            manifest = self._manifest()
            return () if manifest is None else manifest.history
        stage = Stage(
            samples=self._before.samples,
            failed=self._before.failed,
            case_digest=self._before.case_digest,
            software=self._before.software,
            digest=self._before.digest,
        )
        return (*self._before.history, stage)

    @property
    def stiffness(self) -> str | None:
        """Checksum of the stiffness that is there already and stays; None if it is to be made."""
        path = self.folder / STIFFNESS_FILE
        kept = None if self._before is None else self._before.stiffness
        return kept if path.is_file() and sha256(path) == kept else None

    def _kept(self) -> list[Path]:
        """Intact shards and parts in the folder."""
        shards = [self.folder / name for name in self.entries()]
        parts = sorted(self._journal.glob("part-*.h5"))
        return [*shards, *(part for part in parts if _is_intact(part))]

    def _require_shards_of_case(self) -> None:
        """Raise InputError unless every shard and part is of this case."""
        kept = self._kept()
        manifest = self._manifest()
        digests = {self.case.digest()} | (set() if manifest is None else manifest.case_digests)
        for path in kept:
            if read_attributes(path, "nodal")["case_digest"] not in digests:
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

    def complete(self) -> dict[int, ShardEntry]:
        """Entries of the finished shards that hold all their samples, by number."""
        entries, settings, complete = self.entries(), self.case.dataset, {}
        for shard in range(settings.shards):
            entry = entries.get(shard_name(shard))
            if entry and entry.samples + entry.failed == len(settings.samples_of(shard)):
                complete[shard] = entry
        return complete

    def remaining(self) -> dict[int, list[int]]:
        """Numbers of the unsolved samples of each shard that is not complete."""
        complete, remaining, settings = self.complete(), {}, self.case.dataset
        for shard in range(settings.shards):
            if shard not in complete:
                names = ("samples/number", "failed/number")
                done = {int(n) for part in self.parts(shard) for name in names for n in part[name]}
                remaining[shard] = [n for n in settings.samples_of(shard) if n not in done]
        return remaining

    def keep_part(self, shard: int, arrays: Arrays, cell_type: str) -> None:
        """Write the solved part of an unfinished shard, and then its checksum."""
        first = min([*arrays["samples/number"], *arrays["failed/number"]])
        path = self._journal / f"part-{shard:05d}-{first:08d}.h5"
        write_text(path.with_suffix(".sha256"), self._written(path, arrays, cell_type))

    def finish(self, shard: int, parts: list[Arrays], cell_type: str) -> None:
        """Write a shard that has all its samples, and record it."""
        arrays, path = merged(parts), self.folder / shard_name(shard)
        entry = ShardEntry(
            file=path.name,
            samples=len(arrays["samples/number"]),
            failed=len(arrays["failed/number"]),
            sha256=self._written(path, arrays, cell_type),
        )
        self.record(entry)
        self.drop_parts(shard)

    def record(self, entry: ShardEntry) -> None:
        """Record a shard as finished; its file must be complete."""
        path = self._journal / f"{Path(entry.file).stem}.json"
        write_text(path, entry.model_dump_json() + "\n")

    def drop_parts(self, shard: int) -> None:
        """Remove the parts of a finished shard."""
        for path in self._journal.glob(f"part-{shard:05d}-*"):
            path.unlink(missing_ok=True)

    def _written(self, path: Path, arrays: Arrays, cell_type: str) -> str:
        return write_shard(path, "nodal", arrays, self.case.digest(), cell_type, self.case.units)

    def all_shards(self) -> tuple[ShardEntry, ...]:
        """Entries of all shards; those whose samples are in parts are finished first."""
        complete = self.complete()
        for shard in range(self.case.dataset.shards):
            if shard not in complete:
                self.finish(shard, self.parts(shard), self.cell_type(shard))
        complete = self.complete()
        return tuple(complete[shard] for shard in range(self.case.dataset.shards))

    def parts(self, shard: int) -> list[Arrays]:
        """Read the intact parts of an unfinished shard, and the shard that it was before."""
        return [read_shard(path, "nodal") for path in self._paths(shard)]

    def cell_type(self, shard: int) -> str:
        """Type of the cells, as the parts of an unfinished shard have it."""
        return str(read_attributes(self._paths(shard)[0], "nodal")["cell_type"])

    def _paths(self, shard: int) -> list[Path]:
        """The intact parts of an unfinished shard, after the shard that it was before."""
        parts = sorted(self._journal.glob(f"part-{shard:05d}-*.h5"))
        before = [self.folder / shard_name(shard)] if self.extends(shard) else []
        return [*before, *(path for path in parts if _is_intact(path))]

    def extends(self, shard: int) -> bool:
        """True if an unfinished shard has samples in the dataset that grows, which stay in it."""
        if self._before is None:
            return False
        path = self.folder / shard_name(shard)
        entries = {entry.file: entry.sha256 for entry in self._before.shards}
        return path.is_file() and entries.get(path.name) == sha256(path)

    def remove(self) -> None:
        """Remove the journal of a complete dataset."""
        shutil.rmtree(self._journal, ignore_errors=True)

    def close(self) -> None:
        """Unlock the folder."""
        self._lock.close()


class Interruption:
    """Context in which a first signal is only recorded; a second one acts as usual.

    Attributes
    ----------
    asked : bool
        True if a signal has come.
    """

    def __init__(self) -> None:
        self.asked = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interruption:
        for number in SIGNALS:
            self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._restore()

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
        self._restore()

    def _restore(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)


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
    """Raise InputError, which names every difference, unless two cases are the same."""
    if digest_of(found) == digest_of(wanted):
        return
    different = differences(found, wanted)
    if list(different) == [SAMPLES]:
        old, new = different[SAMPLES]
        raise InputError(
            f"--out '{folder}': {SAMPLES} = {new}, but a run of {old} samples is unfinished there; "
            f"expected --samples {old} first"
        )
    said = [_said(key, *values, found, wanted) for key, values in sorted(different.items())]
    raise InputError(f"--out '{folder}': made from another case: {'; '.join(said)}")


def _require_same_or_fewer(folder: Path, found: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Raise InputError unless a complete dataset is of the same case with at most its samples."""
    different = differences(found, wanted)
    if list(different) != [SAMPLES]:
        _require_same(folder, found, wanted)
        return
    old, new = different[SAMPLES]
    if not new > old:
        raise InputError(
            f"--out '{folder}': {SAMPLES} = {new}, the folder has {old}; a dataset can only grow"
        )


def _said(key: str, old: Any, new: Any, found: dict[str, Any], wanted: dict[str, Any]) -> str:
    """Describe one difference between two cases; a file that has changed is named."""
    for section, checksum, file in FILES:
        if key == f"{section}.{checksum}" and found[section].get(file) == wanted[section].get(file):
            return f"the file of {section}.{file} = {wanted[section][file]!r} has changed"
    return difference_text(key, old, new)
