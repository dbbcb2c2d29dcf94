"""Configurations: YAML files, checked by frozen models.

- An unknown key, a key that occurs twice, a wrong type or a value out of range is an error; numbers
  are those of YAML 1.2, and aliases cannot repeat values without end.
- YAML files that come with a program are found by name from any folder.
- ``--set training.epochs=20`` gives new values of single keys.
- Two configurations are compared key by key.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar, get_origin

import yaml
from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError, model_validator

from shared_schema.common.errors import InputError, nearest

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
        names = sorted(p.stem for p in shipped.glob("*.yaml"))
        raise InputError(
            f"{what} '{name}': no such file, and not one of those shipped "
            f"({', '.join(names)}){nearest(name, names)}"
        )
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


MOST_VALUES = 100_000  # of a file, values that aliases and merge keys repeat counted each time
MERGE = "<<"
WHOLE = re.compile(r"^[-+]?[0-9][0-9_]*$")
NUMBER = re.compile(r"^[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)[eE][-+]?[0-9]+$")


class _Loader(yaml.SafeLoader):
    """Safe loader that reads numbers as YAML 1.2 does.

    For YAML 1.1, 1e-3 is text, 010 is 8, and 1:30 is 90.
    """


def _whole_number(loader: _Loader, node: yaml.ScalarNode) -> int | str:
    if ":" in node.value:
        return str(node.value)
    return int(node.value, 10) if WHOLE.match(node.value) else loader.construct_yaml_int(node)


def _number(loader: _Loader, node: yaml.ScalarNode) -> float | str:
    return str(node.value) if ":" in node.value else loader.construct_yaml_float(node)


_Loader.add_implicit_resolver("tag:yaml.org,2002:float", NUMBER, list("-+.0123456789"))
_Loader.add_constructor("tag:yaml.org,2002:int", _whole_number)
_Loader.add_constructor("tag:yaml.org,2002:float", _number)


def yaml_content(text: str) -> Any:
    """Read a YAML document of plain data.

    Raises
    ------
    yaml.YAMLError
        If the text is not valid YAML, a key is no name or occurs twice, a value contains itself, or
        aliases repeat values so often that there are more than `MOST_VALUES`.
    """
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _count(node, {})
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _count(node: yaml.Node, counted: dict[int, int]) -> int:
    """Number of values in a node, repeated ones each time; YAMLError if there are too many."""
    if isinstance(node, yaml.ScalarNode):
        return 1
    if id(node) in counted:
        if counted[id(node)] == 0:
            raise _problem("a value contains itself", node)
        return counted[id(node)]
    counted[id(node)] = 0
    parts = list(node.value)
    if isinstance(node, yaml.MappingNode):
        keys: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise _problem("a list or a mapping as a key, expected a name", key)
            if key.value in keys:
                raise _problem(f"key '{key.value}' occurs twice", key)
            if key.value != MERGE:
                keys.add(key.value)
        parts = [part for pair in node.value for part in pair]
    total = 1 + sum(_count(part, counted) for part in parts)
    if total > MOST_VALUES:
        raise _problem(f"more than {MOST_VALUES} values, with those that aliases repeat", node)
    counted[id(node)] = total
    return total


def _problem(text: str, node: yaml.Node) -> yaml.YAMLError:
    return yaml.constructor.ConstructorError(None, None, text, node.start_mark)


PARENTHESES = re.compile(r"\s*\([^)]*\)")
END_OF_LINE = re.compile(r"[:;](?=\s)|\.(?=\s|$)")


def shipped_files(folder: Path) -> Iterator[tuple[str, dict[str, Any], str]]:
    """Yield name, content and one line of every YAML file of a folder, sorted by name."""
    for path in sorted(folder.glob("*.yaml")):
        yield path.stem, read_yaml(path), one_line(path.read_text(encoding="utf-8"))


def names_in(folder: Path) -> list[str]:
    """Return the names of the YAML files of a folder, sorted."""
    return sorted(path.stem for path in folder.glob("*.yaml"))


def one_line(text: str) -> str:
    """Return the beginning of the comment at the head of a YAML file, without parentheses.

    It ends before the first full stop, colon or semicolon.
    """
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# "))
    comment = PARENTHESES.sub("", " ".join(lines))
    end = END_OF_LINE.search(comment)
    return comment[: end.start()] if end else comment


def changed(content: dict[str, Any], changes: Sequence[str]) -> dict[str, Any]:
    """Return the content of a YAML file with other values of some keys.

    Parameters
    ----------
    content : dict
        Content of the file; not changed.
    changes : sequence of str
        Texts ``KEY=VALUE``. The parts of a key are separated by points, and a number counts the
        entries of a list from 0. A value is YAML, and may be a mapping or a list.

    Raises
    ------
    InputError
        If a text is no ``KEY=VALUE``, a value is not valid YAML, or a key leads into a value that
        has no such part.
    """
    for change in changes:
        key, equals, text = change.partition("=")
        parts = key.strip().split(".")
        if not (equals and all(parts)):
            raise InputError(f"--set '{change}': expected KEY=VALUE, such as training.epochs=20")
        try:
            value = yaml_content(text)
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            reason = " ".join(str(error).split())
            raise InputError(f"--set '{change}': not valid YAML ({reason})") from None
        try:
            content = _with(content, parts, value)
        except ValueError as error:
            raise InputError(f"--set '{change}': {error}") from None
    return content


def _with(content: Any, parts: list[str], value: Any, above: str = "") -> Any:
    """Return a copy of nested mappings and lists with another value at one place."""
    if not parts:
        return value
    part, *rest = parts
    here = f"{above}.{part}".strip(".")
    if isinstance(content, dict):
        return {**content, part: _with(content.get(part, {}), rest, value, here)}
    if isinstance(content, list):
        if not (part.isdecimal() and int(part) < len(content)):
            last = len(content) - 1
            raise ValueError(f"key '{here}': expected a number from 0 to {last} after '{above}'")
        place = int(part)
        return [*content[:place], _with(content[place], rest, value, here), *content[place + 1 :]]
    raise ValueError(f"key '{here}': '{above}' = {content!r} has no parts")


def source_of(source: str, changes: Sequence[str]) -> str:
    """Name a file and the changes of its keys, for error messages."""
    return " ".join([source, *(f"--set {change}" for change in changes)])


LONGEST = 200  # characters of a value in a message


def differences(
    old: Mapping[str, Any], new: Mapping[str, Any], above: str = ""
) -> dict[str, tuple[Any, Any]]:
    """Return old and new value of every key that differs, None where a mapping lacks it.

    Parameters
    ----------
    old, new : mapping
        Keys of mappings in them are joined by points.
    above : str
        What stands before every key.

    Returns
    -------
    dict of str to tuple
        In the order of `old`, then of `new`.
    """
    found: dict[str, tuple[Any, Any]] = {}
    for key in [*old, *(key for key in new if key not in old)]:
        a, b = old.get(key), new.get(key)
        if isinstance(a, dict) and isinstance(b, dict):
            found |= differences(a, b, f"{above}{key}.")
        elif a != b:
            found[above + key] = (a, b)
    return found


def difference_text(key: str, old: Any, new: Any) -> str:
    """Say how a key differs from what a folder has."""
    return f"{key} = {_short(new)}, the folder has {_short(old)}"


def _short(value: Any) -> str:
    """Write a value, the beginning of it if it is long, such as a list of nodes."""
    text = repr(value)
    return text if len(text) <= LONGEST else text[:LONGEST] + " …"
