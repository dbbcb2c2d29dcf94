"""Keys of configuration models: meanings and units from docstrings, lists from JSON Schema."""

from __future__ import annotations

from typing import Annotated, Literal

import pytest
from pydantic import Field, TypeAdapter

from shared_schema.common.configuration import Frozen
from shared_schema.common.configuration_keys import (
    Key,
    as_markdown,
    as_text,
    json_schema,
    keys_of,
    meanings_of,
    summary_of,
    unit_of,
)


class Base(Frozen):
    """Something
    with a shape.

    More about it.

    Attributes
    ----------
    size, width : float
        Lengths in m, of
        ``everything``.
    count : int
    """

    size: float = Field(gt=0, le=1e9)
    width: float = 2.5
    count: int | None = None


class Square(Base):
    """A square.

    Attributes
    ----------
    kind : "square"
        Kind of shape.
    count : int, optional
        Number of squares.
    """

    kind: Literal["square"] = "square"


class Disc(Base):
    """A disc.

    Attributes
    ----------
    kind : "disc"
        Kind of shape.
    at : tuple of 2 floats
        Centre in m.
    """

    kind: Literal["disc"]
    at: tuple[float, float] = (0, 1)


class File(Frozen):
    """A file.

    Attributes
    ----------
    shape : Square or Disc
        The shape.
    parts : tuple of Base
        Parts of it.
    names : tuple of str
        Names.
    """

    shape: Annotated[Square | Disc, Field(discriminator="kind")]
    parts: tuple[Base, ...] = Field((), max_length=3)
    names: tuple[Literal["a", "b"], ...] = ("a",)


KEYS = {(key.name, key.only): key for key in keys_of(json_schema(TypeAdapter(File), "File"))}


def test_meanings_are_those_of_the_docstrings() -> None:
    both = "Lengths in m, of `everything`."
    assert meanings_of(Base) == {"size": both, "width": both}
    assert meanings_of(Square) == {
        "size": both,
        "width": both,
        "kind": "Kind of shape.",
        "count": "Number of squares.",
    }
    assert summary_of(Base) == "Something with a shape."


@pytest.mark.parametrize(
    ("meaning", "unit"),
    [
        ("Young's modulus E in Pa, positive.", "Pa"),
        ("Radius in m.", "m"),
        ("Time in s between two.", "s"),
        ("Smallest in most cases.", ""),
        ("Number of nodes.", ""),
    ],
)
def test_units(meaning: str, unit: str) -> None:
    assert unit_of(meaning) == unit


def test_keys_of_a_section_and_of_its_variants() -> None:
    assert KEYS["shape", ""].type == "section (kind: square | disc)"
    assert KEYS["shape", ""].default == "required"
    assert KEYS["shape.kind", ""].type == "square | disc"
    assert KEYS["shape.size", ""] == Key(
        "shape.size", "", "number > 0, ≤ 1e+09", "m", "required", "Lengths in m, of `everything`."
    )
    assert KEYS["shape.at", "kind: disc"].type == "[number, number]"
    assert KEYS["shape.at", "kind: disc"].default == "[0, 1]"
    assert KEYS["shape.count", "kind: square"].meaning == "Number of squares."
    assert KEYS["shape.count", "kind: disc"].meaning == ""
    assert KEYS["parts", ""].type == "list of 0 to 3 × section"
    assert KEYS["parts.N.count", ""].type == "integer or null"
    assert KEYS["parts.N.count", ""].default == "null"
    assert KEYS["parts.N.width", ""].default == "2.5"
    assert KEYS["names", ""].type == "list of any number × a | b"
    assert KEYS["names", ""].default == "[a]"


def test_text_and_table() -> None:
    key = KEYS["shape.at", "kind: disc"]
    assert as_text([key]) == (
        "shape.at: [number, number] in m; default [0, 1]; only kind: disc\n    Centre in m."
    )
    table = as_markdown([key, KEYS["names", ""]]).splitlines()
    assert (
        table[2]
        == "| `shape.at` (only kind: disc) | [number, number] | m | [0, 1] | Centre in m. |"
    )
    assert table[3] == r"| `names` | list of any number × a \| b |  | [a] | Names. |"
