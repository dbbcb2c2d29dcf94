"""All experiments: the studies of all reports, the benchmarks, and the steps on a GPU."""

from __future__ import annotations

from collections.abc import Sequence

from experiments.beyond.catalogue import BEYOND
from experiments.framework.experiment import Experiment
from experiments.framework.report import Report
from experiments.framework.resources import Resources
from experiments.framework.runner import find
from experiments.organs.catalogue import ORGANS
from experiments.paper.catalogue import REPRODUCTION
from shared_schema.common import InputError

REPORTS = {"reproduce": REPRODUCTION, "beyond": BEYOND, "organs": ORGANS}


def find_studies(names: Sequence[str]) -> tuple[Report, list[Experiment[Resources]]]:
    """Find studies of one report by their names, in the order of the report.

    Raises
    ------
    InputError
        If a name is unknown, or they are of different reports.
    """
    report_of = {study.name: report for report in REPORTS.values() for study in report.studies}
    for name in names:
        if name not in report_of:
            raise InputError(f"study '{name}': expected one of {', '.join(report_of)}")
        if report_of[name] is not report_of[names[0]]:
            raise InputError(f"study '{name}': expected one of the report of '{names[0]}'")
    report = report_of[names[0]]
    return report, find(report.studies, names)
