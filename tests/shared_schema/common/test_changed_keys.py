"""New values of keys of a YAML file."""

from __future__ import annotations

from typing import Any

import pytest

from shared_schema.common.configuration import changed, source_of
from shared_schema.common.errors import InputError

CONTENT: dict[str, Any] = {"a": {"b": 1, "c": 2}, "list": [{"x": 0}, {"y": 1}], "text": "t"}


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("a.b=3", {"a": {"b": 3, "c": 2}}),
        ("a.b=1e-3", {"a": {"b": 1e-3, "c": 2}}),
        ("a.b=", {"a": {"b": None, "c": 2}}),
        ("a={d: [1, 2]}", {"a": {"d": [1, 2]}}),
        ("new.key=true", {"new": {"key": True}}),
        ('list.1.y="> 0"', {"list": [{"x": 0}, {"y": "> 0"}]}),
        ("text=a=b", {"text": "a=b"}),
    ],
)
def test_one_key(change: str, expected: dict[str, Any]) -> None:
    assert changed(CONTENT, [change]) == {**CONTENT, **expected}
    assert CONTENT["a"]["b"] == 1


def test_the_last_change_of_a_key_counts() -> None:
    assert changed(CONTENT, ["a.b=3", "a.c=4", "a.b=5"])["a"] == {"b": 5, "c": 4}


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ("a.b", "expected KEY=VALUE"),
        ("=3", "expected KEY=VALUE"),
        ("a..b=3", "expected KEY=VALUE"),
        ("a.b=[1", "not valid YAML"),
        ("a.b=!!python/name:os.system", "not valid YAML"),
        ("text.b=3", "key 'text.b': 'text' = 't' has no parts"),
        ("list.2.x=3", "key 'list.2': expected a number from 0 to 1 after 'list'"),
        ("list.x=3", "key 'list.x': expected a number from 0 to 1 after 'list'"),
    ],
)
def test_refused(change: str, part: str) -> None:
    with pytest.raises(InputError) as error:
        changed(CONTENT, [change])
    assert str(error.value).startswith(f"--set '{change}': ")
    assert part in str(error.value)


def test_source_says_what_was_changed() -> None:
    assert source_of("a.yaml", []) == "a.yaml"
    assert source_of("a.yaml", ["b=1", "c=2"]) == "a.yaml --set b=1 --set c=2"
