"""Arguments by their annotations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pytest

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import InputError

if TYPE_CHECKING:
    from fractions import Fraction


@checked_arguments
def function(
    *paths: str | Path,
    count: int = 1,
    size: float = 1.0,
    kind: Literal["a", "b"] | None = None,
    names: Sequence[str] = (),
    content: Mapping[str, Any] | None = None,
    unknown: Fraction | None = None,
    is_so: bool = False,
) -> str:
    """Say how many paths there are."""
    return f"{len(paths)} paths"


@pytest.mark.parametrize(
    "given",
    [
        {"count": np.int64(3)},
        {"count": 10**30},
        {"size": 3},
        {"size": np.float32(3)},
        {"size": float("inf")},
        {"kind": "b"},
        {"names": ["a", "b"]},
        {"names": np.array(["a"])},
        {"content": {}},
        {"unknown": "anything"},
        {"is_so": np.bool_(True)},
    ],
    ids=str,
)
def test_right_arguments(given: dict[str, Any]) -> None:
    assert function("a", Path("b"), **given) == "2 paths"
    assert function.__doc__ == "Say how many paths there are."


@pytest.mark.parametrize(
    ("given", "part"),
    [
        ({"count": True}, "count = True: expected a whole number"),
        ({"count": 1.0}, "count = 1.0: expected a whole number"),
        ({"size": 1j}, "size = 1j: expected a number"),
        ({"kind": "c"}, "kind = 'c': expected 'a' or 'b'"),
        ({"kind": 1}, "kind = 1: expected 'a' or 'b'"),
        ({"names": "ab"}, "names = 'ab': expected a sequence, each a text"),
        ({"names": ["a", 1]}, r"names = \['a', 1\]: expected a sequence, each a text"),
        ({"content": [1]}, r"content = \[1\]: expected a mapping"),
        ({"is_so": 0}, "is_so = 0: expected a bool"),
        ({"is_so": "x\n" * 99}, r"is_so = '.{1,60}…: expected a bool"),
    ],
)
def test_wrong_arguments(given: dict[str, Any], part: str) -> None:
    with pytest.raises(InputError, match=part):
        function(**given)


@pytest.mark.parametrize("path", [None, b"a", 3, "a\0", "x" * 300])
def test_wrong_paths(path: Any) -> None:
    with pytest.raises(InputError, match="paths = "):
        function("a", path)


@pytest.mark.parametrize("given", [("",), ("a", "")])
def test_an_empty_text_is_not_the_working_directory(given: tuple[str, ...]) -> None:
    with pytest.raises(InputError, match="paths = '': expected a text or a path, not an empty"):
        function(*given)


def test_arguments_that_there_are_not() -> None:
    with pytest.raises(
        TypeError, match=r"function\(\): got an unexpected keyword argument 'other'"
    ):
        function(other=1)  # type: ignore[call-arg]
