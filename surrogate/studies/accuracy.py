"""Errors on test splits, as several studies put them beside the paper's."""

from __future__ import annotations

from collections.abc import Sequence

from surrogate.evaluation.metrics import ErrorMeasures, measure
from surrogate.evaluation.paper import PaperErrors
from surrogate.studies.record import Comparison, Table, compare
from surrogate.studies.workshop import Workshop

BODIES = {"beam2d": "2D beam", "lshape2d": "2D L-shape", "beam3d": "3D beam"}
LIKELIHOODS = {"deterministic": "D", "maximum_likelihood": "MLE", "variational_bayes": "VB"}
MM = 1e3  # in a metre


def test_errors(workshop: Workshop, run: str) -> ErrorMeasures:
    """Errors of a run on the test split of its dataset."""
    dataset = workshop.dataset_of(run)
    test = dataset.nodal_test
    mean = workshop.predicted_test(run).mean
    return measure(test.force, mean, test.displacement, dataset.geometry.tip)


def name_of(workshop: Workshop, run: str) -> str:
    """Body and likelihood of a run, as the paper's tables name them."""
    config = workshop.scale.config_of(run)
    return f"{BODIES[config.case]} ({LIKELIHOODS[config.likelihood]})"


def accuracy_table(workshop: Workshop, runs: Sequence[str], caption: str) -> Table:
    """M, ē and σ(e) of some runs."""
    rows = []
    for run in runs:
        errors = test_errors(workshop, run)
        mean, std = MM * errors.mean_error, MM * errors.std_error
        rows.append((name_of(workshop, run), errors.samples, mean, std))
    return Table(caption=caption, head=("example", "M", "ē [mm]", "σ(e) [mm]"), rows=tuple(rows))


def error_comparisons(workshop: Workshop, run: str, paper: PaperErrors) -> list[Comparison]:
    """ē and σ(e) of a run beside the paper's."""
    errors, name = test_errors(workshop, run), name_of(workshop, run)
    return [
        compare(f"{name}: ē", "mm", MM * errors.mean_error, paper.mean_error_mm),
        compare(f"{name}: σ(e)", "mm", MM * errors.std_error, paper.std_error_mm),
    ]
