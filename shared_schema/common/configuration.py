"""Frozen configuration models: an unknown key, a wrong type or a value out of range is an error."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar, get_origin

import yaml
from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError, model_validator

from shared_schema.common.errors import InputError
from shared_schema.common.yaml_reader import yaml_content

logger = logging.getLogger(__name__)
LARGEST_FILE = 1 << 20  # bytes of a YAML file
TOP_LEVEL = "(top level)"


class Frozen(BaseModel):
    """Base of every configuration model: immutable; unknown keys are errors.

    Plain values are not converted: true and '6' are no numbers, 6 is no text. Whole numbers are
    floats as well, and lists are tuples.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

    @model_validator(mode="before")
    @classmethod
    def _with_tuples(cls, content: Any) -> Any:
        """Make tuples of the lists in a file, except for the keys that are lists."""
        if not isinstance(content, dict):
            return content
        fields = cls.model_fields
        lists = {name for name in fields if get_origin(fields[name].annotation) is list}
        return {key: value if key in lists else _as_tuple(value) for key, value in content.items()}


def _as_tuple(value: Any) -> Any:
    return tuple(map(_as_tuple, value)) if isinstance(value, list) else value


def absent(value: Any) -> bool:
    """True for None: the ``exclude_if`` of keys that older files do not have."""
    return value is None


Model = TypeVar("Model")


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a YAML file that holds one mapping.

    Raises
    ------
    InputError
        If the file is missing, is not valid YAML, holds a key twice or more than can be meant
        (`yaml_content`), or does not hold a mapping.
    """
    try:
        with path.open("rb") as file:
            text = file.read(LARGEST_FILE + 1)
        if len(text) > LARGEST_FILE:
            raise InputError(f"{path}: expected at most {LARGEST_FILE} bytes")
        content = yaml_content(text.decode("utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid YAML ({' '.join(str(error).split())})") from None
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected a mapping of keys to values")
    return content


def read_named(name: str, shipped: Path, what: str) -> tuple[dict[str, Any], str]:
    """Read a YAML file by its path, or a shipped one by its name.

    Parameters
    ----------
    name : str
        Path of a file, or name of a shipped one without its ending.
    shipped : Path
        Folder of the shipped files.
    what : str
        Kind of file, for the error message.

    Returns
    -------
    content : dict
    source : str
        Path of the file.

    Raises
    ------
    InputError
        If neither exists or both do, or the file holds no mapping.
    """
    path, own = Path(name), shipped / f"{name}.yaml"
    if name == path.name and own.is_file():
        _tell_apart(name, own, what)
    if not path.is_file():
        path = own
    if not path.is_file():
        names = ", ".join(sorted(p.stem for p in shipped.glob("*.yaml")))
        raise InputError(f"{what} '{name}': no such file, and not one of those shipped ({names})")
    return read_yaml(path), str(path)


def _tell_apart(name: str, shipped: Path, what: str) -> None:
    """Refuse the name of a file here and of a shipped one; warn of a file with its ending."""
    here = Path(shipped.name)
    if Path(name).is_file():
        raise InputError(
            f"{what} '{name}': a file of this name lies here and one is shipped, "
            f"expected './{name}' or '{shipped}'"
        )
    if here.is_file() and not here.samefile(shipped):
        logger.warning(
            "%s '%s': the shipped one is read; the file here is './%s'", what, name, here
        )


def validate(
    model: type[Model] | TypeAdapter[Model], content: Any, source: str, context: Any = None
) -> Model:
    """Build a configuration model from plain data, or name the first key that is wrong.

    Parameters
    ----------
    model : type or TypeAdapter
        Configuration model, or adapter of a union of some.
    content : Any
        Content that was read, usually a dictionary.
    source : str
        Origin of the content, for the error message.
    context : Any, optional
        What validators of the model may look at besides.

    Raises
    ------
    InputError
        One line: source, key, value and what was expected.
    """
    try:
        adapter = model if isinstance(model, TypeAdapter) else TypeAdapter(model)
        return adapter.validate_python(content, context=context)
    except ValidationError as error:
        raise InputError(f"{source}: {first_problem(error, content)}") from None


def first_problem(error: ValidationError, content: Any = None) -> str:
    """Describe the first problem of a pydantic error in one line: key, value, expectation.

    The tag of a tagged union, written in parentheses, stands behind the message; one that is a
    value in `content`, such as the kind of a mesh, is left out. An unknown key beside a missing one
    of nearly the same name is the problem, not what is missing.
    """
    problems = error.errors(include_url=False)
    for one in problems:
        one["loc"] = _keys(one["loc"], content, one["type"] == "missing")
    problem = problems[0]
    if problem["type"] == "missing":
        unknown = {
            str(other["loc"][-1]): other
            for other in problems
            if other["type"] == "extra_forbidden" and other["loc"][:-1] == problem["loc"][:-1]
        }
        if close := get_close_matches(str(problem["loc"][-1]), unknown, 1):
            typo = ".".join(map(str, unknown[close[0]]["loc"]))
            return f"unknown key '{typo}', expected '{problem['loc'][-1]}'"
    tags = [str(part) for part in problem["loc"] if str(part).startswith("(")]
    key = ".".join(str(part) for part in problem["loc"] if str(part) not in tags) or TOP_LEVEL
    return " ".join([_message(key, problem), *tags])


def _keys(location: tuple[int | str, ...], content: Any, missing: bool) -> tuple[int | str, ...]:
    """Return the keys of a location, without tags of unions that are values of the content."""
    keys: list[int | str] = []
    for number, part in enumerate(location, 1):
        if isinstance(content, Mapping):
            is_value = any(isinstance(v, str) and v == part for v in content.values())
            ends_here = number == len(location) and (missing or part in content)
            goes_on = isinstance(content.get(part), (Mapping, list, tuple))
            if is_value and not (ends_here or goes_on):
                continue
        keys.append(part)
        try:
            content = content[part]
        except (IndexError, KeyError, TypeError):
            content = None
    return tuple(keys)


def _message(key: str, problem: Any) -> str:
    if problem["type"] == "extra_forbidden":
        return f"unknown key '{key}'"
    if problem["type"] == "missing":
        return f"key '{key}' is missing"
    if problem["type"] == "union_tag_invalid":
        context = problem["ctx"]
        return f"found {context['tag']}, expected one of {context['expected_tags']}"
    message = problem["msg"].removeprefix("Value error, ")
    for start in ("key '", "unknown key '"):
        if message.startswith(start):  # a part that was built by itself: its key is below this one
            if key == TOP_LEVEL:
                return str(message)
            return f"{start}{key}.{message.removeprefix(start)}"
    value = problem["input"]
    found = "" if isinstance(value, (dict, list, tuple, BaseModel)) else f" = {value!r}"
    return f"key '{key}'{found}: {message[:1].lower()}{message[1:]}"
