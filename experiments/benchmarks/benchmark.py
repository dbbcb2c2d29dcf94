"""Benchmarks: experiments with options, published as JSON records and a page made from these."""

from __future__ import annotations

import argparse
import logging
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from experiments.framework.experiment import Experiment, Findings, Setting
from experiments.framework.machine import ROOT, machine
from experiments.framework.quiet import quiet
from experiments.framework.record import DatasetRecord, Record, read_record, record_path
from experiments.framework.runner import measured
from shared_schema import MANIFEST, DatasetReader, digest_of, read_manifest
from shared_schema.common import Parser, write_text

DOCS = ROOT / "docs"
RESULTS, PREFIX = DOCS / "results", "benchmark-"
Results = dict[str, Any]
FUNCTIONS = ("measure", "page", "arguments", "variant", "overview")


class Options(Setting):
    """Parsed options of a benchmark, and where it is measured.

    Parameters
    ----------
    options : argparse.Namespace
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options

    def configuration(self) -> dict[str, Any]:
        """All options, paths as text."""
        return {
            name: value if isinstance(value, int | float | str | None) else str(value)
            for name, value in vars(self.options).items()
        }

    def machine(self) -> dict[str, Any]:
        """Describe processor and load."""
        return machine()

    def used_datasets(self, experiment: Experiment[Any]) -> dict[str, DatasetRecord]:
        """Entries of the datasets among the options."""
        values = [v for value in vars(self.options).values() for v in np.atleast_1d(value)]
        folders = [v for v in values if isinstance(v, Path) and (v / MANIFEST).is_file()]
        manifests = {str(folder): read_manifest(folder) for folder in folders}
        return {
            name: DatasetRecord(case=m.name, samples=m.samples, digest=m.digest)
            for name, m in manifests.items()
        }

    def fingerprint(self, experiment: Experiment[Any]) -> str:
        """Digest of the benchmark, its options and its datasets."""
        datasets = {name: of.digest for name, of in self.used_datasets(experiment).items()}
        return digest_of(
            {"benchmark": experiment.name, **self.configuration(), "datasets": datasets}
        )


@dataclass(frozen=True)
class Benchmark:
    """A benchmark: a module with the functions below, and TITLE, ABOUT and PART (`of`).

    Attributes
    ----------
    name : str
    title : str
        Heading of its page.
    measure : callable
        Measures, and returns the results, from the parsed options.
    page : callable
        Makes what the page says of one record from its results.
    arguments : callable
        Adds the options to a parser.
    variant : callable
        End of the name of the record, from the options; empty if there is one only.
    overview : callable
        Makes what the page says of all records together, after `about`.
    about : str
        What holds for all records, at the head of the page; keys of the results in braces.
    part : str
        Heading of each of several records, with keys of results and software in braces.
    """

    name: str
    title: str
    measure: Callable[[argparse.Namespace], Results]
    page: Callable[[Results], str]
    arguments: Callable[[Parser], object] = lambda _: None
    variant: Callable[[argparse.Namespace], str] = lambda _: ""
    overview: Callable[[Sequence[Record]], str] = lambda _: ""
    about: str = ""
    part: str = ""

    @classmethod
    def of(cls, module: ModuleType) -> Benchmark:
        """Make the benchmark of a module from its functions and its constants in capitals."""
        name = module.__name__.rpartition(".")[2].replace("_", "-")
        given: dict[str, Any] = {
            **{key: getattr(module, key) for key in FUNCTIONS if hasattr(module, key)},
            **{key: getattr(module, key.upper(), "") for key in ("about", "part")},
        }
        return cls(name, module.TITLE, **given)

    def run(self, words: Sequence[str], command: str) -> Path:
        """Measure with some options; write the record and the page, and return the page's path."""
        parser = argparse.ArgumentParser(prog=command, description=self.title)
        self.arguments(parser)
        options = parser.parse_args(words)
        name = "-".join(filter(None, (self.name, self.variant(options))))
        with quiet(logging.INFO):
            measured(self.experiment(name), Options(options), RESULTS, " ".join([command, *words]))
        return self.publish()

    def experiment(self, name: str) -> Experiment[Options]:
        """Return the benchmark as an experiment, whose record is the file of some name."""

        def measure(place: Options) -> Findings:
            return Findings(numbers=self.measure(place.options))

        return Experiment(f"{PREFIX}{name}", self.title, "", measure)

    def publish(self) -> Path:
        """Write the page."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_text(self.path, self.whole_page())
        return self.path

    @property
    def path(self) -> Path:
        """File of the page."""
        return DOCS / "benchmarks" / f"{self.name}.md"

    def whole_page(self) -> str:
        """Make the page of all records."""
        files = [record_path(RESULTS, f"{PREFIX}{self.name}")]
        files += sorted(RESULTS.glob(f"{PREFIX}{self.name}-*.json"))
        records = [record for file in files if (record := read_record(file))]
        about = self.about.format_map(records[0].findings.numbers)
        blocks = [f"# {self.title}", about, self.overview(records)]
        for record in records:
            numbers = record.findings.numbers
            if len(records) > 1 and self.part:
                blocks.append(f"## {self.part.format_map({**record.software, **numbers})}")
            blocks += [self.page(numbers), made_by(record)]
        return "\n\n".join(block.strip() for block in blocks if block) + "\n"


def case_of(dataset: Path) -> str:
    """Case of a structured dataset."""
    return DatasetReader(dataset, "structured").manifest.name


def stored_record(name: str) -> Record:
    """Read the record of a benchmark.

    Raises
    ------
    FileNotFoundError
        If there is none.
    """
    path = record_path(RESULTS, f"{PREFIX}{name}")
    record = read_record(path)
    if record is None:
        raise FileNotFoundError(path)
    return record


def made_by(record: Record) -> str:
    """Processor, software and command of a record."""
    of = ("dolfinx", "dolfinx") if "dolfinx" in record.software else ("PyTorch", "torch")
    return (
        f"{record.machine['processor']}, {record.machine['cores']} cores, "
        f"{of[0]} {record.software[of[1]]}: `{without_environment(record.command)}`"
    )


def without_environment(command: str) -> str:
    """Command without the single thread and the folder of its environment."""
    return re.sub(r"\.venv-\w+/bin/python", "python", command.removeprefix("OMP_NUM_THREADS=1 "))
