"""Lines of a text file that a user has written."""

from __future__ import annotations

from pathlib import Path

from shared_schema.common.errors import InputError

LARGEST = 1 << 26  # bytes


def text_lines(path: Path, option: str) -> list[str]:
    """Lines of a UTF-8 file.

    Raises
    ------
    InputError
        That names option and file, if it is too large or cannot be read.
    """
    try:
        if path.stat().st_size > LARGEST:
            raise InputError(f"{option} '{path}': expected at most {LARGEST} bytes")
        return path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{option} '{path}': cannot be read ({error})") from None
