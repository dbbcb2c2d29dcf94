"""A disk that a test can fill or make read-only: a tmpfs in a separate mount namespace."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest


class SmallDisk:
    """A disk that only commands in its mount namespace see; `close` removes it.

    Parameters
    ----------
    folder : Path
        Mount point in the namespace.
    options : str
        Options of tmpfs, such as ``size=1m`` or ``nr_inodes=9``.

    Attributes
    ----------
    folder : Path
        Mount point in the namespace.
    seen : Path
        Path of the same folder outside the namespace.
    """

    def __init__(self, folder: Path, options: str) -> None:
        folder.mkdir()
        self.folder = folder
        user = [] if os.getuid() == 0 else ["--user", "--map-root-user"]
        held = ["sh", "-c", f"mount -t tmpfs -o {options} tmpfs '{folder}' && echo made && cat"]
        self._holder = subprocess.Popen(
            ["unshare", *user, "--mount", *held],
            stdin=subprocess.PIPE,  # the process ends when this pipe is closed
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self._holder.stdout is not None
        if self._holder.stdout.readline() != "made\n":
            pytest.skip(f"no mounting here: {self._holder.communicate()[1].strip()}")
        namespaces = [*user[:1], "--mount"]
        kept = ["--root", "--wd"]  # in a chroot, a new mount namespace alone would leave it
        self._enter = ["nsenter", "--target", str(self._holder.pid), *namespaces, *kept]
        self._enter += ["--preserve-credentials"] if user else []
        self.seen = Path(f"/proc/{self._holder.pid}/root{folder}")

    def words(self, words: list[str]) -> list[str]:
        """Command that runs another command in the namespace."""
        return [*self._enter, *words]

    def remount(self, options: str) -> None:
        """Change the options; wait while an open file prevents ``ro``."""
        remount = ["mount", "-o", f"remount,{options}", "tmpfs", str(self.folder)]
        for _ in range(1000):
            done = subprocess.run(self.words(remount), capture_output=True, check=False)
            if done.returncode == 0:
                return
        pytest.fail(f"could not remount with {options}")

    def close(self) -> None:
        """Remove the disk with its content."""
        self._holder.communicate(timeout=60)
