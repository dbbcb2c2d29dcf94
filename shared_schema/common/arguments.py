"""Arguments of public functions: wrong ones are an InputError, not an error from deep inside.

Arrays that are handed out without a copy are read-only.
"""

from __future__ import annotations

import errno
import inspect
import os
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from functools import cache, wraps
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError, first_line

P = ParamSpec("P")
R = TypeVar("R")
SHOWN = 40  # characters of a wrong value
WORDS = {str: "a text", Path: "a path", int: "a whole number", float: "a number", bool: "a bool"}


def checked_arguments(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function so that it raises InputError for arguments of another type.

    Types are those of its annotations: texts, paths, numbers, sequences of these, literals, and
    classes that its module imports. A path is one that a file may have, and no empty text.
    Annotations of other kinds, such as arrays, are not looked at.
    """
    signature = inspect.signature(function)

    @cache
    def kinds() -> dict[str, Any]:
        """Return the types of the arguments; they are evaluated at the first call."""
        return {name: _evaluated(p.annotation, function) for name, p in named(signature).items()}

    @wraps(function)
    def checking(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            given = signature.bind(*args, **kwargs).arguments
        except TypeError as error:
            raise TypeError(f"{function.__qualname__}(): {error}") from None
        for name, kind in kinds().items():
            if name in given:
                is_many = signature.parameters[name].kind is inspect.Parameter.VAR_POSITIONAL
                for value in given[name] if is_many else (given[name],):
                    require_type(name, value, kind)
        return function(*args, **kwargs)

    return checking


def named(signature: inspect.Signature) -> dict[str, inspect.Parameter]:
    """Return the parameters that have an annotation."""
    parameters = signature.parameters.items()
    return {name: p for name, p in parameters if p.annotation is not p.empty}


def _evaluated(annotation: Any, function: Callable[..., Any]) -> Any:
    """Return the type that an annotation means; object if its module does not import it."""
    while isinstance(annotation, str):
        try:
            annotation = eval(annotation, function.__globals__)  # as typing.get_type_hints does
        except (NameError, TypeError):  # TypeError: of an alias that is a text itself
            return object
    return annotation


def require_type(name: str, value: Any, kind: Any) -> None:
    """Raise InputError, naming the argument, if a value is not of a type."""
    if not _is_of(value, kind):
        shown = repr(value).replace("\n", " ")
        shown = shown if len(shown) <= SHOWN else f"{shown[:SHOWN]}…"
        raise InputError(f"{name} = {shown}: expected {_in_words(kind)}")
    for text in _paths(value, kind):
        if text == "":  # as a path, it would be the working directory
            raise InputError(f"{name} = '': expected {_in_words(kind)}, not an empty text")
        path = Path(text)
        try:
            path.stat()
        except ValueError as error:
            raise InputError(f"{name} = {str(path)!r}: expected a path ({error})") from None
        except OSError as error:
            if error.errno == errno.ENAMETOOLONG:
                raise InputError(f"{name} = '{str(path)[:SHOWN]}…': too long a path") from None


def _paths(value: Any, kind: Any) -> list[str | os.PathLike[str]]:
    """Return the paths that a value of a type is or holds, as they are given."""
    if isinstance(value, str | os.PathLike):
        return [value] if Path in _alternatives(kind) else []
    if not isinstance(value, list | tuple):
        return []
    parts = [get_args(one)[0] for one in _alternatives(kind) if get_origin(one) is Sequence]
    return [path for part in parts for one in value for path in _paths(one, part)]


def _alternatives(kind: Any) -> tuple[Any, ...]:
    return get_args(kind) if get_origin(kind) in (Union, types.UnionType) else (kind,)


def _is_of(value: Any, kind: Any) -> bool:
    """Whether a value is of a type, as far as the type can be checked."""
    alternatives = _alternatives(kind)
    if len(alternatives) > 1:
        return any(_is_of(value, one) for one in alternatives)
    if kind is Any:
        return True
    if kind is None or kind is type(None):
        return value is None
    if kind is int:
        return isinstance(value, Integral) and not isinstance(value, bool)
    if kind is float:
        return isinstance(value, Real) and not isinstance(value, bool)
    if kind is bool:
        return isinstance(value, bool | np.bool_)
    if kind is Path:
        return isinstance(value, os.PathLike)
    origin = get_origin(kind)
    if origin is Literal:
        return any(type(value) is type(one) and value == one for one in get_args(kind))
    if origin is Sequence:
        is_sequence = isinstance(value, Sequence) and not isinstance(value, str | bytes)
        is_sequence = is_sequence or (isinstance(value, np.ndarray) and value.ndim > 0)
        return is_sequence and all(_is_of(one, get_args(kind)[0]) for one in value)
    if origin is Mapping:
        return isinstance(value, Mapping)
    is_class = isinstance(kind, type) and not getattr(kind, "_is_protocol", False)
    return isinstance(value, kind) if is_class else True


def _in_words(kind: Any) -> str:
    """Say what values a type has."""
    alternatives = _alternatives(kind)
    if len(alternatives) > 1:
        words = [_in_words(one) for one in alternatives if one not in (None, type(None))]
        return " or ".join(dict.fromkeys(words))
    if get_origin(kind) is Literal:
        return " or ".join(map(repr, get_args(kind)))
    if get_origin(kind) is Sequence:
        return f"a sequence, each {_in_words(get_args(kind)[0])}"
    if get_origin(kind) is Mapping:
        return "a mapping"
    return WORDS.get(kind) or f"a {getattr(kind, '__name__', kind)}"


def real_numbers(value: Any, name: str) -> NDArray[np.float64]:
    """Return real numbers in double precision, of an array, a tensor, or nested sequences.

    The array is a new one: what is done with it does not change the caller's numbers, nor does the
    caller change it later.

    Raises
    ------
    InputError
        If they are complex, masked, sparse, or no numbers.
    """
    if hasattr(value, "detach"):  # a tensor, which may require gradients
        if value.is_meta or "strided" not in str(value.layout):
            raise InputError(f"{name} are a tensor without all its numbers, expected a dense one")
        value = value.detach().cpu().resolve_conj().resolve_neg()
        value = (value if value.is_complex() else value.double()).numpy()
    if np.ma.isMaskedArray(value):
        raise InputError(f"{name} are a masked array, expected an array without a mask")
    try:
        found = np.asarray(value)
        if found.dtype.kind == "O":
            found = found.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} are no array of numbers ({first_line(error)})") from None
    if found.dtype.kind not in "biuf":
        kind = "complex" if found.dtype.kind == "c" else f"of type {found.dtype}"
        raise InputError(f"{name} are {kind}, expected real numbers")
    return np.array(found, np.float64)


Kind = TypeVar("Kind", bound=np.generic)


def read_only(values: NDArray[Kind]) -> NDArray[Kind]:
    """Return a view of the same numbers; writing to it raises ValueError."""
    view = values.view()
    view.setflags(write=False)
    return view


def hold_read_only(record: Any) -> None:
    """Let a frozen dataclass hold its arrays, and those in its mappings, as such views."""
    for each in fields(record):
        value = getattr(record, each.name)
        if isinstance(value, np.ndarray):
            object.__setattr__(record, each.name, read_only(value))
        elif isinstance(value, dict):
            views = {
                name: read_only(one) if isinstance(one, np.ndarray) else one
                for name, one in value.items()
            }
            object.__setattr__(record, each.name, views)
