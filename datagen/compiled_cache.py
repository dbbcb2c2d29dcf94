"""Folders that keep compiled code from one start to the next."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from shared_schema.common.errors import InputError

VARIABLE = "XDG_CACHE_HOME"


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
