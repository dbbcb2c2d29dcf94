"""The seal of a run folder: ``manifest.json`` with the checksums of all finished files.

`train` writes it with the checksum of ``config.yaml``, and adds the results when it has finished;
`evaluate` adds its files. A file that belongs in the manifest and is not listed there is not
finished. Run folders of earlier versions have no manifest; their files are read unchecked.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from pydantic import Field

from shared_schema.common.configuration import Frozen, validate
from shared_schema.common.errors import InputError
from shared_schema.common.files import require_inside, require_plain, sha256, write_text
from shared_schema.manifest import MANIFEST, digest_of


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
