"""Requirements with their tests and records; each is held by a test at least."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

from pydantic import Field

from experiments.framework.machine import ROOT
from experiments.framework.record import Record, read_record
from shared_schema.common import Frozen, InputError, read_yaml, validate

FILE = Path(__file__).with_name("requirements.yaml")
SEPARATOR = "::"  # between the file and the function of a test


class Requirement(Frozen):
    """Something that a program is required to do.

    Attributes
    ----------
    requirement : str
    tests : tuple of str
        FILE::FUNCTION below ``tests``.
    held : str
        What the tests hold: bound, reference, number of cases.
    record : str or None
        File below ``docs/results`` that a figure was measured in.
    measured : str or None
        The figure, with the record's numbers in braces.
    """

    requirement: str = Field(min_length=1)
    tests: tuple[str, ...] = Field(min_length=1)
    held: str = Field(min_length=1)
    record: str | None = None
    measured: str | None = None

    def figure(self) -> str:
        """What was measured, and at which commit; empty without a record.

        Raises
        ------
        InputError
            If there is no such record, or no such number in it.
        """
        if self.record is None or self.measured is None:
            if self.record != self.measured:
                raise InputError(f"'{self.requirement}': expected record and measured, or none")
            return ""
        record = self.found_record(self.record)
        try:
            text = self.measured.format_map(record.findings.numbers)
        except (KeyError, IndexError, ValueError, TypeError) as error:
            raise InputError(f"'{self.requirement}': {self.record} has no {error}") from None
        commit = record.software["commit"].removesuffix("-dirty")
        return f"{text} ([`{commit}`](results/{self.record}))"

    def found_record(self, name: str) -> Record:
        """Read a record."""
        record = read_record(ROOT / "docs" / "results" / name)
        if record is None:
            raise InputError(f"'{self.requirement}': no record {name}")
        return record

    def require_tests(self) -> None:
        """Raise InputError unless each of its tests exists."""
        for test in self.tests:
            path, separator, function = test.partition(SEPARATOR)
            if not separator or function not in functions_of(ROOT / "tests" / path):
                raise InputError(f"'{self.requirement}': no test tests/{test}")


class Area(Frozen):
    """Requirements of one kind."""

    area: str
    requirements: tuple[Requirement, ...] = Field(min_length=1)


class Requirements(Frozen):
    """All requirements."""

    areas: tuple[Area, ...] = Field(min_length=1)


def read_requirements(path: Path = FILE) -> tuple[Area, ...]:
    """Read the requirements; each of their tests exists.

    Raises
    ------
    InputError
        If the file is damaged, or a requirement has no test, or one that does not exist.
    """
    areas = validate(Requirements, read_yaml(path), str(path)).areas
    for area in areas:
        for requirement in area.requirements:
            requirement.require_tests()
    return areas


@cache
def functions_of(path: Path) -> frozenset[str]:
    """Names of the test functions of a file; none if there is no file."""
    if not path.is_file():
        return frozenset()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    functions = (node for node in tree.body if isinstance(node, ast.FunctionDef))
    return frozenset(node.name for node in functions if node.name.startswith("test_"))
