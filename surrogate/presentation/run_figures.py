"""The figures of one evaluated run, drawn into its ``figures/`` folder."""

from __future__ import annotations

from shared_schema.drawing.figure_style import save
from surrogate.evaluation.evaluate import Evaluation
from surrogate.evaluation.metrics import displacement_at_load, sample_errors
from surrogate.presentation import figures, uncertainty_figures
from surrogate.runs.folder import RunFolder
from surrogate.uncertainty.calibration import CalibrationMeasures


def write_figures(evaluation: Evaluation, run: RunFolder) -> None:
    """Draw the paper's figures of one run into its ``figures/`` folder."""
    run.figures.mkdir(exist_ok=True)
    geometry = evaluation.surrogate.geometry
    example = evaluation.example
    predicted, reference = evaluation.predicted[example], evaluation.reference[example]
    force = evaluation.force[example]
    save(
        figures.deformed_meshes(geometry, predicted, reference, force), run.figures / "deformed.png"
    )
    save(figures.error_field(geometry, predicted, reference), run.figures / "error_field.png")
    errors = sample_errors(evaluation.predicted, evaluation.reference)
    moved = displacement_at_load(evaluation.force, evaluation.reference)
    save(figures.sorted_errors(moved, errors, evaluation.measures), run.figures / "errors.png")
    lines = run.metric_lines()
    if lines and lines[-1]["epoch"] > 0:  # what is fitted has no epochs
        name = run.description().run.objective
        save(figures.loss_curves({name: lines}), run.figures / "loss.png")
    if evaluation.calibration is not None:
        _write_uncertainty_figures(evaluation, evaluation.calibration, run)


def _write_uncertainty_figures(
    evaluation: Evaluation, calibration: CalibrationMeasures, run: RunFolder
) -> None:
    geometry, distribution = evaluation.surrogate.geometry, evaluation.distribution
    free, example = ~geometry.clamped, evaluation.example
    error = evaluation.predicted - evaluation.reference
    name = run.description().run.name
    drawn = {
        "calibration": uncertainty_figures.calibration_curve({name: calibration}),
        "error_against_uncertainty": uncertainty_figures.error_against_uncertainty(
            distribution.std[:, free], error[:, free]
        ),
        "uncertainty_field": uncertainty_figures.uncertainty_field(
            geometry, distribution.mean[example], distribution.std[example]
        ),
    }
    extrapolation = evaluation.extrapolation
    if extrapolation is not None and extrapolation.node is not None:
        drawn["sweep"] = uncertainty_figures.sweep(extrapolation)
    for file, figure in drawn.items():
        save(figure, run.figures / f"{file}.png")
