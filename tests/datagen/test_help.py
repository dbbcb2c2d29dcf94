"""The help of every command: what it does, every argument, examples that can be parsed."""

from __future__ import annotations

import pytest

from datagen.command_line import _parser
from tests.help_texts import assert_described, assert_examples_parse, commands_of

PARSER = _parser()


@pytest.mark.parametrize("name", commands_of(PARSER))
def test_every_argument_is_described(name: str) -> None:
    assert_described(PARSER, name)


@pytest.mark.parametrize("name", commands_of(PARSER))
def test_examples_are_valid(name: str) -> None:
    assert_examples_parse(PARSER, name)
