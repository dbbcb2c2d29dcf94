"""The help of every command: what it does, every argument, examples that can be parsed."""

from __future__ import annotations

import argparse
import re
import shlex

import pytest

from datagen.command_line import _parser

PARSER = _parser()
(COMMANDS,) = (a.choices for a in PARSER._actions if isinstance(a, argparse._SubParsersAction))
REDIRECTION = re.compile(r" > \S+$")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_argument_is_described(name: str) -> None:
    parser = COMMANDS[name]
    assert parser.description
    for action in parser._actions:
        assert action.help, f"{name}: {action.option_strings or action.dest}"


@pytest.mark.parametrize("name", COMMANDS)
def test_examples_are_valid(name: str) -> None:
    head, *examples = str(COMMANDS[name].epilog).splitlines()
    assert head in ("example:", "examples:")
    assert examples
    for example in examples:
        words = shlex.split(REDIRECTION.sub("", example))
        program = words.index("datagen")
        assert words[program + 1] == name
        options = PARSER.parse_args(words[program + 1 :])
        assert callable(options.command)
