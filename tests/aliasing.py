"""What a call must not do: write to what it is given, and read again what it has returned.

Every call is made in two worlds, twice in each. One is left in peace. In the other the first
results, and the arguments of the first call, are overwritten before the second call, whose
arguments are read-only. All numbers are the same in both, bit by bit.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

World = TypeVar("World")
TIMES = ("seconds",)  # fields that are no result of a computation


def parts_of(value: Any) -> list[Any]:
    """Parts of a container or record; none of anything else."""
    if isinstance(value, Mapping):
        return list(value.values())
    if isinstance(value, list | tuple):
        return list(value)
    if is_dataclass(value) and not isinstance(value, type):
        return [getattr(value, each.name) for each in fields(value) if each.name not in TIMES]
    return []


def array_of(value: Any) -> np.ndarray[Any, Any] | None:
    """The array that a value is, or that shares its memory with a tensor."""
    if hasattr(value, "detach"):
        value = value.detach().numpy()
    return value if isinstance(value, np.ndarray) else None


def bits(value: Any) -> Any:
    """All numbers and texts in a value, to compare."""
    array = array_of(value)
    if array is not None:
        content = repr(array.tolist()) if array.dtype == object else array.tobytes()
        return str(array.dtype), array.shape, content
    if isinstance(value, np.generic | str | bytes | int | float | None):
        return repr(value)
    return type(value).__name__, [bits(part) for part in parts_of(value)]


def overwrite(value: Any, in_record: bool = False) -> None:
    """Write wrong numbers to all arrays that can be written to; empty lists and mappings.

    Only records keep those that they hold.
    """
    array = array_of(value)
    if array is not None:
        if array.flags.writeable:
            array[...] = ~array if array.dtype == bool else np.array(-77, array.dtype)
        return
    for part in parts_of(value):
        overwrite(part, in_record or is_dataclass(value))
    if isinstance(value, list | dict) and not in_record:
        value.clear()


def freeze(value: Any) -> Any:
    """Make all arrays in a value read-only; tensors cannot be."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    for part in parts_of(value):
        freeze(part)
    return value


def require_no_aliases(
    call: Callable[[World, dict[str, Any]], Any],
    worlds: tuple[World, World],
    given: Callable[[], dict[str, Any]],
) -> None:
    """Fail if a call writes to what it is given, or reads again what it was given or returned."""
    peaceful, wild = worlds
    expected = [bits(call(peaceful, given())) for _ in range(2)]
    arguments = given()
    before = bits(arguments)
    result = call(wild, arguments)
    assert bits(arguments) == before, "it writes to its arguments"
    assert bits(result) == expected[0], "results differ at once"
    overwrite(result)
    overwrite(arguments)
    result = call(wild, freeze(given()))
    assert bits(result) == expected[1], "it reads what it was given, or has returned"


def public_names(kinds: Iterable[type], packages: tuple[str, ...]) -> set[str]:
    """Name, as "Class.method", of all public methods and properties that the packages define.

    Fields of a record are left out: they are the caller's, as the record is.
    """
    found = set()
    for kind in kinds:
        for name in dir(kind):
            owner = next(each for each in kind.__mro__ if name in vars(each))
            is_ours = owner.__module__.partition(".")[0] in packages
            is_public = not name.startswith("_") or name == "__call__"
            is_code = hasattr(vars(owner)[name], "__get__")
            if is_ours and is_public and is_code and name not in _field_names(kind):
                found.add(f"{kind.__name__}.{name}")
    return found


def public_functions(package: Any) -> set[str]:
    """Functions among the public names of a package."""
    return {name for name in package.__all__ if inspect.isfunction(getattr(package, name))}


def _field_names(kind: type) -> set[str]:
    return {each.name for each in fields(kind)} if is_dataclass(kind) else set()
