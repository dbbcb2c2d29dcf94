"""Errors of runs on their test splits: measures, table, and comparisons with the paper."""

from __future__ import annotations

from collections.abc import Sequence

from experiments.framework.record import Comparison, Table, compare
from experiments.framework.resources import Resources
from experiments.paper.published_numbers import PaperErrors
from surrogate.learning.measures import ErrorMeasures, measure

BODIES = {"beam2d": "2D beam", "lshape2d": "2D L-shape", "beam3d": "3D beam"}
LIKELIHOODS = {"deterministic": "D", "maximum_likelihood": "MLE", "variational_bayes": "VB"}
MM = 1e3  # mm in a metre


def split_errors(resources: Resources, run: str) -> ErrorMeasures:
    """Errors of a run on the test split of its dataset."""
    dataset = resources.dataset_of(run)
    test = dataset.nodal_test
    mean = resources.predicted_test(run).mean
    return measure(test.force, mean, test.displacement, dataset.geometry.tip)


def name_of(resources: Resources, run: str) -> str:
    """Name of a run in the paper's tables: body and likelihood."""
    config = resources.config_of(run)
    return f"{BODIES[config.case]} ({LIKELIHOODS[config.likelihood]})"


def accuracy_table(resources: Resources, runs: Sequence[str], caption: str) -> Table:
    """Table of M, ē and σ(e) of several runs."""
    rows = []
    for run in runs:
        errors = split_errors(resources, run)
        mean, std = MM * errors.mean_error, MM * errors.std_error
        rows.append((name_of(resources, run), errors.samples, mean, std))
    return Table(caption=caption, head=("example", "M", "ē [mm]", "σ(e) [mm]"), rows=tuple(rows))


def error_comparisons(resources: Resources, run: str, paper: PaperErrors) -> list[Comparison]:
    """Comparisons of ē and σ(e) of a run with the paper's."""
    errors, name = split_errors(resources, run), name_of(resources, run)
    return [
        compare(f"{name}: ē", "mm", MM * errors.mean_error, paper.mean_error_mm),
        compare(f"{name}: σ(e)", "mm", MM * errors.std_error, paper.std_error_mm),
    ]
