"""Checks of the help that every command of both programs gives."""

from __future__ import annotations

import argparse
import re
import shlex

REDIRECTION = re.compile(r" > \S+$")


def commands_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Parsers of the commands of a program, by name."""
    (actions,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    return dict(actions.choices)


def assert_described(parser: argparse.ArgumentParser, name: str) -> None:
    """Assert that a command and each of its arguments have a description."""
    command = commands_of(parser)[name]
    assert command.description
    for action in command._actions:
        assert action.help, f"{name}: {action.option_strings or action.dest}"


def assert_examples_parse(parser: argparse.ArgumentParser, name: str) -> None:
    """Assert that a command has examples, which it can read."""
    head, *examples = str(commands_of(parser)[name].epilog).splitlines()
    assert head in ("example:", "examples:")
    assert examples
    for example in examples:
        words = shlex.split(REDIRECTION.sub("", example))
        program = words.index(parser.prog)
        assert words[program + 1] == name
        assert callable(parser.parse_args(words[program + 1 :]).command)
