"""A disk that a test may fill up or make read-only: a tmpfs in a mount namespace of its own."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest


class SmallDisk:
    """A disk that only commands entering its namespace see; it is gone with `close`.

    Parameters
    ----------
    folder : Path
        Where these commands see it.
    options : str
        Of tmpfs, such as ``size=1m`` or ``nr_inodes=9``.

    Attributes
    ----------
    folder : Path
    seen : Path
        The same, as seen from everywhere else.
    """

    def __init__(self, folder: Path, options: str) -> None:
        folder.mkdir()
        self.folder = folder
        user = [] if os.getuid() == 0 else ["--user", "--map-root-user"]
        held = ["sh", "-c", f"mount -t tmpfs -o {options} tmpfs '{folder}' && echo made && cat"]
        self._holder = subprocess.Popen(
            ["unshare", *user, "--mount", *held],
            stdin=subprocess.PIPE,  # whose end ends it
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self._holder.stdout is not None
        if self._holder.stdout.readline() != "made\n":
            pytest.skip(f"no mounting here: {self._holder.communicate()[1].strip()}")
        self._enter = ["nsenter", "--target", str(self._holder.pid), *user[:1], "--mount"]
        self._enter += ["--preserve-credentials"] if user else []
        self.seen = Path(f"/proc/{self._holder.pid}/root{folder}")

    def words(self, words: list[str]) -> list[str]:
        """The command that runs another where the disk is."""
        return [*self._enter, *words]

    def remount(self, options: str) -> None:
        """Change its options; waits while a file is open that ``ro`` would forbid."""
        remount = ["mount", "-o", f"remount,{options}", "tmpfs", str(self.folder)]
        for _ in range(1000):
            done = subprocess.run(self.words(remount), capture_output=True, check=False)
            if done.returncode == 0:
                return
        pytest.fail(f"could not remount with {options}")

    def close(self) -> None:
        """End it, with all that is on it."""
        self._holder.communicate(timeout=60)
