"""The figures of an evaluation in the run folder."""

from __future__ import annotations

from matplotlib.figure import Figure

from surrogate.evaluation.run_evaluation import Evaluation
from surrogate.figures.calibration_curves import calibration_curves
from surrogate.figures.error_figures import error_over_displacement, error_over_uncertainty
from surrogate.figures.field_figures import error_field, uncertainty_field
from surrogate.figures.loss_curves import loss_curves
from surrogate.figures.mesh_figures import deformed_meshes
from surrogate.figures.stress_figures import von_mises_beside_reference
from surrogate.figures.sweep_curves import sweep_curves
from surrogate.measures.error_metrics import displacement_at_load, sample_errors
from surrogate.probabilistic.calibration import CalibrationMeasures
from surrogate.runs.folder import RunFolder


def run_figures(evaluation: Evaluation, run: RunFolder) -> dict[str, Figure]:
    """Draw all figures of an evaluation by their names.

    Parameters
    ----------
    evaluation : Evaluation
    run : RunFolder
        Folder whose measures of the epochs are drawn as well.
    """
    drawn = _error_figures(evaluation, run.description().run.title)
    lines = run.metric_lines()
    if lines and lines[-1]["epoch"] > 0:  # a fitted model has no epochs
        drawn["loss"] = loss_curves({run.description().run.objective: lines})
    if evaluation.calibration is not None:
        name = run.description().run.name
        drawn |= _uncertainty_figures(evaluation, evaluation.calibration, name)
    return drawn


def _error_figures(evaluation: Evaluation, title: str) -> dict[str, Figure]:
    geometry, example = evaluation.surrogate.geometry, evaluation.example
    predicted, reference = evaluation.predicted[example], evaluation.reference[example]
    errors = sample_errors(evaluation.predicted, evaluation.reference)
    moved = displacement_at_load(evaluation.force, evaluation.reference)
    force = evaluation.force[example]
    drawn = {
        "deformed": deformed_meshes(geometry, predicted, reference, force, title),
        "error_field": error_field(geometry, predicted, reference),
        "errors": error_over_displacement(moved, errors, evaluation.measures),
    }
    if evaluation.stress is not None:
        ours = evaluation.surrogate.stresses(predicted)["von_mises"]
        theirs = evaluation.surrogate.stresses(reference)["von_mises"]
        drawn["von_mises"] = von_mises_beside_reference(
            geometry, predicted, reference, (ours, theirs)
        )
    return drawn


def _uncertainty_figures(
    evaluation: Evaluation, calibration: CalibrationMeasures, name: str
) -> dict[str, Figure]:
    geometry, distribution = evaluation.surrogate.geometry, evaluation.distribution
    free, example = ~geometry.clamped, evaluation.example
    error = evaluation.predicted - evaluation.reference
    drawn = {
        "calibration": calibration_curves({name: calibration}),
        "error_against_uncertainty": error_over_uncertainty(
            distribution.std[:, free], error[:, free]
        ),
        "uncertainty_field": uncertainty_field(
            geometry, distribution.mean[example], distribution.std[example]
        ),
    }
    extrapolation = evaluation.extrapolation
    if extrapolation is not None and extrapolation.node is not None:
        drawn["sweep"] = sweep_curves(extrapolation)
    return drawn
