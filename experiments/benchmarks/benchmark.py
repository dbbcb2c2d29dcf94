"""Benchmarks: experiments with options of their own, published as JSON and a page made from it."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
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
    """A benchmark.

    Attributes
    ----------
    name : str
    title : str
        Heading of its page, with keys of the results in braces.
    measure : callable
        Measures, and returns the results, from the parsed options.
    page : callable
        Makes the page between its heading and its last lines from the results.
    arguments : callable
        Adds the options to a parser.
    variant : callable
        End of the name in the names of both files, from the options; empty if there is one only.
    """

    name: str
    title: str
    measure: Callable[[argparse.Namespace], Results]
    page: Callable[[Results], str]
    arguments: Callable[[Parser], object] = lambda _: None
    variant: Callable[[argparse.Namespace], str] = lambda _: ""

    def run(self, words: Sequence[str], command: str) -> Path:
        """Measure with some options; write the record and the page, and return the page's path."""
        parser = argparse.ArgumentParser(prog=command, description=self.title)
        self.arguments(parser)
        options = parser.parse_args(words)
        name = "-".join(filter(None, (self.name, self.variant(options))))
        with quiet(logging.INFO):
            measured(self.experiment(name), Options(options), RESULTS, " ".join([command, *words]))
        return self.publish(name)

    def experiment(self, name: str) -> Experiment[Options]:
        """Return the benchmark as an experiment, whose record is the file of some name."""

        def measure(place: Options) -> Findings:
            return Findings(numbers=self.measure(place.options))

        return Experiment(f"{PREFIX}{name}", self.title, "", measure)

    def publish(self, name: str) -> Path:
        """Write the page of the record of some name."""
        path = page_path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, self.page_of(stored_record(name)))
        return path

    def page_of(self, record: Record) -> str:
        """Make the whole page of a record."""
        numbers = record.findings.numbers
        return f"# {self.title.format_map(numbers)}\n\n{self.page(numbers)}\n{footer(record)}"


def page_path(name: str) -> Path:
    """Page of a benchmark."""
    return DOCS / "benchmarks" / f"{name}.md"


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


def footer(record: Record) -> str:
    """Last lines of a page: machine, software and command."""
    machine, versions = record.machine, record.software
    before, after = machine["load_averages"]
    software = (
        f"dolfinx {versions['dolfinx']}, PETSc {versions['petsc']}, {versions['mpi']}"
        if "dolfinx" in versions
        else f"PyTorch {versions['torch']}"
    )
    return (
        f"{machine['processor']}, {machine['cores']} cores, load average {before:.1f} before and "
        f"{after:.1f} after;\n{software}. Made by\n\n<!-- not run: takes minutes -->\n"
        f"```sh\n{record.command}\n```\n"
    )
