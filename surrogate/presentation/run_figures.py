"""The figures of one evaluated run, drawn into its ``figures/`` folder."""

from __future__ import annotations

from matplotlib.figure import Figure

from shared_schema.drawing.figure_style import save
from surrogate.evaluation.error_metrics import displacement_at_load, sample_errors
from surrogate.evaluation.evaluate import Evaluation
from surrogate.presentation.calibration_curves import calibration_curves
from surrogate.presentation.error_figures import error_over_displacement, error_over_uncertainty
from surrogate.presentation.field_figures import error_field, uncertainty_field
from surrogate.presentation.loss_curves import loss_curves
from surrogate.presentation.mesh_figures import deformed_meshes
from surrogate.presentation.sweep_curves import sweep_curves
from surrogate.runs.folder import RunFolder
from surrogate.uncertainty.calibration import CalibrationMeasures


def write_figures(evaluation: Evaluation, run: RunFolder) -> None:
    """Draw the paper's figures of one run into its ``figures/`` folder."""
    drawn = _error_figures(evaluation)
    lines = run.metric_lines()
    if lines and lines[-1]["epoch"] > 0:  # a fitted model has no epochs
        drawn["loss"] = loss_curves({run.description().run.objective: lines})
    if evaluation.calibration is not None:
        name = run.description().run.name
        drawn |= _uncertainty_figures(evaluation, evaluation.calibration, name)
    run.figures.mkdir(exist_ok=True)
    for file, figure in drawn.items():
        save(figure, run.figures / f"{file}.png")


def _error_figures(evaluation: Evaluation) -> dict[str, Figure]:
    geometry, example = evaluation.surrogate.geometry, evaluation.example
    predicted, reference = evaluation.predicted[example], evaluation.reference[example]
    errors = sample_errors(evaluation.predicted, evaluation.reference)
    moved = displacement_at_load(evaluation.force, evaluation.reference)
    force = evaluation.force[example]
    return {
        "deformed": deformed_meshes(geometry, predicted, reference, force),
        "error_field": error_field(geometry, predicted, reference),
        "errors": error_over_displacement(moved, errors, evaluation.measures),
    }


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
