"""Commands of the pages exist with their options, also where no block of code is run."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

import datagen.command_line
import surrogate.command_line
from tests.documentation.page import Block, blocks_of
from tests.documentation.pages import PAGES
from tests.end_to_end.commands import ROOT
from website.reference import commands_of

PARSERS = {
    "datagen": datagen.command_line._parser(),
    "surrogate": surrogate.command_line._parser(),
}
TARGETS = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
STARTED = re.compile(r"(?:^|^(?:\S*mpirun|\S*torchrun|srun) .*|/)(datagen|surrogate) ([a-z].*)")
WRITTEN = re.compile(r"`(?:\S+=\S+ )*(make|datagen|surrogate) ([a-z][\w-]*)([^`]*)`")
THE_END = re.compile(r" (?:[>|&#]|&&)|;")


def lines_of(page: Path) -> list[str]:
    """Lines of shell on a page; where a block is shortened for its test, as the reader has it."""
    blocks: list[Block] = [example.parsed for example in blocks_of(page)]
    shell = [block.source.replace("\\\n", " ") for block in blocks if block.language == "sh"]
    return [THE_END.split(line.strip())[0] for line in "\n".join(shell).splitlines()]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_blocks_have_commands_that_there_are(page: Path) -> None:
    for line in lines_of(page):
        if line.startswith("make "):
            words = [w for w in shlex.split(line)[1:] if "=" not in w and not w.startswith("-")]
            assert set(words) <= set(TARGETS), line
        elif started := STARTED.search(line):
            PARSERS[started[1]].parse_args(shlex.split(started[2]))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_sentences_name_commands_and_options_that_there_are(page: Path) -> None:
    for program, name, rest in WRITTEN.findall(page.read_text()):
        if program == "make":
            assert name in TARGETS, (program, name)
            continue
        commands = commands_of(PARSERS[program])
        assert name in commands, (program, name)
        options = {text for action in commands[name]._actions for text in action.option_strings}
        assert set(re.findall(r"(?<!\S)--[\w-]+", rest)) <= options, (program, name, rest)


def test_pages_have_commands() -> None:
    """What the tests above look at is there: README starts programs and names targets."""
    lines = lines_of(ROOT / "README.md")
    assert any(line.startswith("make ") for line in lines)
    assert any(STARTED.search(line) for line in lines)
    assert sum(len(WRITTEN.findall(page.read_text())) for page in PAGES) > 50
