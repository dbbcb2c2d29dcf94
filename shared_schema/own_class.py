"""A user's own class in a Python file, named ``FILE.py:ClassName`` by a case file.

Such classes are load families and materials.

The file is code and runs with the user's rights. It is imported only when a case file is read,
never when a dataset is.
"""

from __future__ import annotations

import hashlib
import sys
import traceback
from pathlib import Path
from types import ModuleType
from typing import Any

from shared_schema.common.errors import first_line


def import_class(path: Path, class_name: str) -> tuple[Any, str]:
    """Import a class of a Python file.

    Parameters
    ----------
    path : Path
    class_name : str

    Returns
    -------
    type
        The attribute of that name, whatever it is.
    str
        SHA-256 of the file as it was imported.

    Raises
    ------
    ValueError
        If the file cannot be read, its code ends with an error, or it has no such name.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ValueError(f"{path} cannot be read ({error.strerror})") from None
    digest = hashlib.sha256(content).hexdigest()
    module = ModuleType(f"own_class_{digest[:16]}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module  # type hints of a class are looked up there
    try:
        exec(compile(content, str(path), "exec"), module.__dict__)
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:
        raise ValueError(f"{path} cannot be imported: {described(error, path)}") from None
    if not hasattr(module, class_name):
        raise ValueError(f"{path} has no class '{class_name}'")
    return getattr(module, class_name), digest


def described(error: BaseException, path: Path | None = None) -> str:
    """Type and text of an error of a user's code, with its last line in the user's file."""
    text = f"{type(error).__name__}: {first_line(error)}"
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if path and frame.filename == str(path)]
    return f"{text} (line {lines[-1]})" if lines else text


def source_of(thing: Any) -> Path | None:
    """File of the class of an object, if it has one."""
    file = getattr(sys.modules.get(type(thing).__module__), "__file__", None)
    return Path(file) if file else None


def import_named(
    what: str, name: str, shipped: tuple[str, ...], base: type[Any], folder: Path | None
) -> tuple[type[Any], str]:
    """Import ``FILE.py:ClassName`` relative to a folder.

    Parameters
    ----------
    what : str
        Kind of class, for the error message.
    name : str
    shipped : tuple of str
        Names that need no file, for the error message.
    base : type
        Class that it must be derived from.
    folder : Path, optional
        Folder of the case file; without one nothing is imported.

    Returns
    -------
    type
    str
        SHA-256 of the file.

    Raises
    ------
    ValueError
        If it is no such class, or its file cannot be imported.
    """
    file, _, class_name = name.rpartition(":")
    if not (file.endswith(".py") and class_name.isidentifier()):
        raise ValueError(
            f"{what} '{name}': expected one of {', '.join(shipped)} or FILE.py:ClassName"
        )
    if folder is None:
        raise ValueError(f"{what} '{name}': own classes are read with a case file only")
    try:
        found, digest = import_class(folder / file, class_name)
    except ValueError as error:
        raise ValueError(f"{what} '{name}': {error}") from None
    if not (isinstance(found, type) and issubclass(found, base)):
        raise ValueError(f"{what} '{name}': expected a subclass of {base.__name__}")
    return found, digest
