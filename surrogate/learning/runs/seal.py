"""What tells that nothing has changed in a run folder: its manifest, and checksums of lines.

`train` writes ``manifest.json`` with the checksum of ``config.yaml``, and adds the results when it
has finished; `evaluate` adds its files. A file that belongs in the manifest and is not listed there
is not finished. Run folders of earlier versions have no manifest; their files are read unchecked.

``metrics.jsonl`` has one line per epoch, each with a checksum of its own; lines are only appended.
A line that a crash cut short has no end; it is left out. Any other line that is not as it was
written is damage, and so is a missing line between two others.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from shared_schema.common.configuration import Frozen, validate
from shared_schema.common.errors import InputError
from shared_schema.common.files import require_inside, require_plain, sha256, write_text
from shared_schema.manifest import MANIFEST, digest_of

CHECK = "check"
CHECK_LENGTH = 16  # hexadecimal digits
Line = dict[str, Any]


class RunManifest(Frozen):
    """Content of the manifest of a run folder.

    Attributes
    ----------
    version : int
    files : dict of str to str
        SHA-256 of every finished file, by its path in the folder.
    digest : str
        SHA-256 of everything above.
    """

    version: Literal[1] = 1
    files: dict[str, str] = Field(default_factory=dict)
    digest: str = ""

    def sealed(self) -> RunManifest:
        """Return a copy with its own digest filled in."""
        content = self.model_dump(mode="json", exclude={"digest"})
        return self.model_copy(update={"digest": digest_of(content)})

    def spelled(self) -> str:
        """Text of the file, in its one canonical spelling."""
        return json.dumps(self.model_dump(mode="json"), indent=1, ensure_ascii=True) + "\n"


class Seal:
    """The manifest of one run folder.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.path = folder, folder / MANIFEST

    @property
    def exists(self) -> bool:
        """True if the folder has a manifest."""
        return self.path.is_file()

    def files(self) -> dict[str, str]:
        """Read the checksums of the finished files; empty without a manifest.

        Raises
        ------
        InputError
            If the manifest is damaged, a link, or lists a file outside of the folder.
        """
        require_plain(self.folder, self.path)
        if not self.exists:
            return {}
        try:
            text = self.path.read_text(encoding="ascii")
            content = json.loads(text)
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(f"{self.path}: not valid JSON ({error})") from None
        manifest = validate(RunManifest, content, str(self.path))
        if manifest.sealed() != manifest or manifest.spelled() != text:
            raise InputError(f"{self.path}: damaged, its content does not match its digest")
        for name in manifest.files:
            try:
                require_inside(self.folder, self.folder / name)
            except InputError as error:
                raise InputError(f"{self.path}: lists {error}") from None
        return manifest.files

    def lists(self, path: Path) -> bool:
        """True if a file is finished: listed in the manifest, or there if there is no manifest."""
        return self._name(path) in self.files() if self.exists else path.is_file()

    def require_intact(self, *paths: Path) -> None:
        """Raise InputError if some files, or all listed ones, are missing, damaged, or links."""
        files = self.files()
        for name in map(self._name, paths) if paths else files:
            path, checksum = self.folder / name, files.get(name)
            require_plain(self.folder, path)
            if checksum is None:
                continue
            if not path.is_file():
                raise InputError(f"{path}: no such file, {MANIFEST} lists it")
            if sha256(path) != checksum:
                raise InputError(f"{path}: damaged, its checksum does not match {MANIFEST}")

    def make(self, *paths: Path) -> None:
        """Write a new manifest that lists some files."""
        self._write({self._name(path): sha256(path) for path in paths})

    def add(self, paths: Iterable[Path]) -> None:
        """List finished files; a folder without a manifest stays without one."""
        if self.exists:
            self._write(self.files() | {self._name(path): sha256(path) for path in paths})

    def withdraw(self, paths: Iterable[Path]) -> None:
        """List some files no longer."""
        names = {self._name(path) for path in paths}
        if self.exists:
            self._write({n: checksum for n, checksum in self.files().items() if n not in names})

    def _name(self, path: Path) -> str:
        return path.relative_to(self.folder).as_posix()

    def _write(self, files: dict[str, str]) -> None:
        ordered = dict(sorted(files.items()))
        write_text(self.path, RunManifest(files=ordered).sealed().spelled())


def spelled(line: Mapping[str, Any]) -> str:
    """Text of a line, with its checksum as the last entry."""
    return json.dumps({**line, CHECK: digest_of(dict(line))[:CHECK_LENGTH]}) + "\n"


def append_line(path: Path, line: Mapping[str, Any]) -> None:
    """Append a line, synchronised with the disk; an OSError names the file."""
    try:
        with path.open("a", encoding="ascii") as file:
            file.write(spelled(line))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


def write_lines(path: Path, lines: Iterable[Mapping[str, Any]]) -> None:
    """Write a file of lines; it appears complete or not at all."""
    write_text(path, "".join(spelled(line) for line in lines))


def read_lines(path: Path, checked: bool) -> list[Line]:
    """Read all complete lines, without their checksums.

    Parameters
    ----------
    path : Path
    checked : bool
        Every line must have a checksum; lines of earlier versions have none.

    Raises
    ------
    InputError
        If a line is damaged, has no checksum, or is not of the epoch after that of the line before;
        the first epoch is 1, or 0 for a model that is fitted directly.
    """
    if not path.is_file():
        return []
    lines: list[Line] = []
    for number, text in enumerate(path.read_bytes().split(b"\n")[:-1], start=1):
        if not text and not checked:  # files of earlier versions may have been edited
            continue
        line = _line(text, checked)
        if line is None:
            raise InputError(f"{path}: line {number} is damaged")
        expected = lines[-1]["epoch"] + 1 if lines else min(line["epoch"], 1)
        if line["epoch"] != expected:
            raise InputError(
                f"{path}: line {number} is of epoch {line['epoch']}, expected {expected}"
            )
        lines.append(line)
    return lines


def _line(text: bytes, checked: bool) -> Line | None:
    """Content of a line; None if it is damaged."""
    try:
        line = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(line, dict):
        return None
    is_checked = line.pop(CHECK, None) is not None
    if (checked or is_checked) and spelled(line).encode() != text + b"\n":
        return None
    return line if _is_measured(line) else None


def _is_measured(line: Line) -> bool:
    """True if a line has an epoch and, if any, numbers only."""
    epoch, seconds = line.get("epoch"), line.get("seconds", 0.0)
    return (
        all(isinstance(v, int | float) and not isinstance(v, bool) for v in line.values())
        and isinstance(epoch, int)
        and epoch >= 0
        and math.isfinite(seconds)
    )
