"""Code blocks of a Markdown page, run one after another as a reader would run them.

A block with a title (```` ```yaml title="case.yaml" ````) is written to a file of that name. Blocks
of ``sh`` run in bash with both programs on the path, but commands of the learner in this
process, which has PyTorch loaded, as blocks of ``python``; all of a page in one empty folder.
Comments before a block change this:

``not run: REASON``
    The block is not run.
``shortened: OLD => NEW; OLD => NEW``
    Texts are replaced, so that the block takes seconds.
``prepared: COMMAND``
    A shell command runs before; ``$ROOT`` is the repository.
``merged into: NAME``
    YAML that stands for the shipped configuration or case NAME with these keys changed.
``exit code: N``
    The exit code of the last command, 0 by default.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import yaml
from sybil import Document, Example, Region
from sybil.parsers.markdown.lexers import RawFencedCodeBlockLexer

from surrogate.learning.models.kinds import run_config
from surrogate.learning.runs.config_reader import read_recipe
from tests.end_to_end.commands import DATAGEN, ROOT, SURROGATE, execute

INFO = re.compile(r"(?P<info>[^\n]*)\n")
COMMENTS = re.compile(r"((?:^ *<!-- .*? -->\n)+)\Z", re.MULTILINE)
COMMENT = re.compile(
    r"<!-- (?P<name>not run|shortened|prepared|merged into|exit code): (?P<value>.+?) -->"
)
TITLE = re.compile(r'^(?P<language>\w*)(?: title="(?P<title>[^"]+)")?$')
LEARNER = re.compile(r"surrogate [^|&;<>$*`]+")  # what needs no shell
BASH = ("bash", "-euo", "pipefail", "-c")
CASES = ROOT / "datagen" / "configs"


@dataclass(frozen=True)
class Block:
    """A code block with the comments before it.

    Attributes
    ----------
    language, title, source : str
    comments : tuple of (str, str)
        Names and values.
    """

    language: str
    title: str
    source: str
    comments: tuple[tuple[str, str], ...]

    def values(self, name: str) -> list[str]:
        """Values of the comments of one name."""
        return [value for key, value in self.comments if key == name]

    @property
    def shortened(self) -> str:
        """The source with its texts replaced; AssertionError if one of them does not occur."""
        source = self.source
        for pair in "; ".join(self.values("shortened")).split("; "):
            old, arrow, new = pair.partition(" => ")
            assert not arrow or old in source, f"'{old}' is not in the block"
            source = source.replace(old, new) if arrow else source
        return source


def blocks_of(path: Path) -> Document:
    """Parse a page into the examples that its blocks are."""
    return Document.parse(str(path), _regions)


def _regions(document: Document) -> Iterator[Region]:
    for region in RawFencedCodeBlockLexer(INFO)(document):
        if region.lexemes["info"].startswith("{"):
            continue  # a directive for Sphinx
        info = TITLE.match(region.lexemes["info"].strip())
        assert info is not None, f"{document.path}: {region.lexemes['info']}"
        before = COMMENTS.search(document.text[: region.start])
        found = COMMENT.findall(before[1]) if before else []
        source = str(region.lexemes["source"])
        block = Block(info["language"], info["title"] or "", source, tuple(found))
        yield Region(region.start, region.end, block, _evaluate)


def _evaluate(example: Example) -> str | None:
    block: Block = example.parsed
    if block.values("not run"):
        return None
    for command in block.values("prepared"):
        _shell(command, 0)
    source = block.shortened
    for name in block.values("merged into"):
        source = _merged(source, name)
    if block.title:
        Path(block.title).write_text(source)
    elif block.language == "sh":
        _shell(source, int((block.values("exit code") or ["0"])[0]))
    elif block.language == "python":
        code = compile("\n" * example.line + source, example.path, "exec", dont_inherit=True)
        exec(code, example.namespace)
    elif not block.values("merged into"):
        return f"'{block.language}' has no way to be run: expected a title, or 'not run: REASON'"
    return None


def _shell(commands: str, code: int) -> None:
    """Run lines of shell; all parts but the last must succeed."""
    *first, last = _parts(commands)
    for words in first:
        execute(*words)
    execute(*last, code=code)


def _parts(commands: str) -> Iterator[list[str]]:
    """Words of single commands of the learner, and of bash for the lines between them."""
    lines = commands.replace("\\\n", " ").splitlines(keepends=True)
    for of_learner, group in groupby(lines, lambda line: LEARNER.fullmatch(line) is not None):
        if of_learner:
            for line in group:
                yield [str(SURROGATE), *shlex.split(line, comments=True)[1:]]
        else:
            programs = f"PATH={DATAGEN.parent}:{SURROGATE.parent}:{os.environ['PATH']}"
            yield ["env", programs, f"ROOT={ROOT}", *BASH, "".join(group)]


def _merged(source: str, name: str) -> str:
    """Put keys into a shipped configuration or case; a configuration is validated."""
    case = CASES / f"{name}.yaml"
    if case.is_file():
        return yaml.safe_dump(_updated(yaml.safe_load(case.read_text()), yaml.safe_load(source)))
    content = _updated(read_recipe(name)[0], yaml.safe_load(source))
    run_config(content, source)
    return yaml.safe_dump(content)


def _updated(content: dict[str, Any], keys: dict[str, Any]) -> dict[str, Any]:
    """Replace keys, and those of sections of the same kind."""
    result = content | keys
    for key, value in keys.items():
        old = content.get(key)
        is_other = isinstance(value, dict) and {"family", "model"} & value.keys()
        if isinstance(value, dict) and isinstance(old, dict) and not is_other:
            result[key] = _updated(old, value)
    return result
