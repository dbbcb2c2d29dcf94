"""The figures of an evaluation in the run folder."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from surrogate.figures.curves import calibration_curves, loss_curves, sweep_curves
from surrogate.figures.error_figures import error_over_displacement, error_over_uncertainty
from surrogate.figures.field_figures import error_field, uncertainty_field
from surrogate.figures.mesh_figures import deformed_meshes
from surrogate.figures.stress_figures import von_mises_beside_reference
from surrogate.learning.measures.error_metrics import displacement_at_load, sample_errors
from surrogate.learning.probabilistic.calibration import CalibrationMeasures

if TYPE_CHECKING:
    from surrogate.learning.evaluation.run_evaluation import Evaluation
    from surrogate.learning.runs.folder import RunFolder

Drawings = dict[str, Callable[[], Figure]]


def evaluation_figures(evaluation: Evaluation, run: RunFolder) -> Drawings:
    """Return functions that draw the figures of an evaluation, by the figures' names.

    Parameters
    ----------
    evaluation : Evaluation
    run : RunFolder
        Folder whose measures of the epochs are drawn as well.
    """
    drawings = _error_figures(evaluation, run.description().run.title)
    lines = run.metric_lines()
    if lines and lines[-1]["epoch"] > 0:  # a fitted model has no epochs
        drawings["loss"] = lambda: loss_curves({run.description().run.objective: lines})
    if evaluation.calibration is not None:
        name = run.description().run.name
        drawings |= _uncertainty_figures(evaluation, evaluation.calibration, name)
    return drawings


def _error_figures(evaluation: Evaluation, title: str) -> Drawings:
    geometry, example = evaluation.surrogate.geometry, evaluation.example
    predicted, reference = evaluation.predicted[example], evaluation.reference[example]
    errors = sample_errors(evaluation.predicted, evaluation.reference)
    moved = displacement_at_load(evaluation.force, evaluation.reference)
    force = evaluation.force[example]

    def von_mises() -> Figure:
        load, body = evaluation.acting[example], evaluation.surrogate.body
        both = (body.stresses_under(load, u) for u in (predicted, reference))
        ours, theirs = (fields["von_mises"][0] for fields in both)
        return von_mises_beside_reference(geometry, predicted, reference, (ours, theirs))

    drawings: Drawings = {
        "deformed": partial(deformed_meshes, geometry, predicted, reference, force, title),
        "error_field": partial(error_field, geometry, predicted, reference),
        "errors": partial(
            error_over_displacement, moved, errors, evaluation.measures, geometry.units
        ),
    }
    return drawings if evaluation.stress is None else drawings | {"von_mises": von_mises}


def _uncertainty_figures(
    evaluation: Evaluation, calibration: CalibrationMeasures, name: str
) -> Drawings:
    geometry, distribution = evaluation.surrogate.geometry, evaluation.distribution
    free, example = ~geometry.clamped, evaluation.example
    error = evaluation.predicted - evaluation.reference
    mean, std = distribution.mean[example], distribution.std[example]
    drawings: Drawings = {
        "calibration": partial(calibration_curves, {name: calibration}),
        "error_against_uncertainty": partial(
            error_over_uncertainty, distribution.std[:, free], error[:, free], geometry.units
        ),
        "uncertainty_field": partial(uncertainty_field, geometry, mean, std),
    }
    extrapolation = evaluation.extrapolation
    if extrapolation is not None and extrapolation.node is not None:
        drawings["sweep"] = partial(sweep_curves, extrapolation, units=geometry.units)
    return drawings
