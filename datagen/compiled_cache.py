"""Folders that keep compiled code from one start to the next.

Files of killed processes are removed, by which FFCx knows that a kernel is being compiled. A
process that compiles a kernel first makes its source file ``libffcx_….c``, and at last
``libffcx_….c.cached``; another process that needs the kernel waits between the two.
"""

from __future__ import annotations

import logging
import os
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from shared_schema.common.errors import InputError

VARIABLE = "XDG_CACHE_HOME"
logger = logging.getLogger(__name__)
PROCESSES = Path("/proc")


def cache_of(name: str) -> Path:
    """Folder of a program below the user's cache folder, ``$XDG_CACHE_HOME`` or ``~/.cache``."""
    return Path(os.environ.get(VARIABLE) or Path.home() / ".cache") / name


def writable(cache: Path) -> Path:
    """Make a cache folder if there is none, and return it.

    Raises
    ------
    InputError
        If it cannot be written to; it names the environment variable that leads elsewhere.
    """
    try:
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=cache):
            pass
    except OSError as error:
        raise InputError(
            f"the cache of compiled code '{cache}' cannot be written to ({error.strerror}), "
            f"expected a folder that can: set the environment variable {VARIABLE} to one"
        ) from None
    return cache


def remove_stale_locks(cache: Path, older_than: float) -> bool:
    """Remove the source files of kernels that nobody compiles any more, with a warning.

    They are unfinished, unchanged for some time, and no compiler runs on them.

    Parameters
    ----------
    cache : Path
        Folder of the compiled kernels.
    older_than : float
        Time in s.

    Returns
    -------
    bool
        True if there were some.
    """
    before, removed = time.time() - older_than, 0
    for lock in cache.glob("libffcx_*.c"):
        with suppress(OSError):  # finished, or removed by another process, meanwhile
            if lock.with_suffix(".c.cached").exists() or lock.stat().st_mtime > before:
                continue
            if not _is_compiled(lock.stem):
                lock.unlink()
                removed += 1
    if removed:
        text = "removed %d unfinished kernels, left in '%s' by compilations that were killed"
        logger.warning(text, removed, cache)
    return removed > 0


def _is_compiled(kernel: str) -> bool:
    """Whether a process on this machine names a kernel in its command line (Linux)."""
    for command in PROCESSES.glob("[0-9]*/cmdline"):
        with suppress(OSError):  # ended meanwhile
            if kernel.encode() in command.read_bytes():
                return True
    return False
