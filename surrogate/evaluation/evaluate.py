"""Evaluation of a run on the test split: its measures, the content of ``evaluation.json``."""

from __future__ import annotations

import json
import platform
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from shared_schema.common.errors import InputError
from surrogate.certify.conformal import Intervals
from surrogate.certify.fast_certificate import FastCertificate
from surrogate.data.body_check import BODY_KEYS, Body, require_same_body
from surrogate.data.dataset import Dataset
from surrogate.data.joined_dataset import read_dataset
from surrogate.evaluation.error_metrics import ErrorMeasures, measure, sample_errors
from surrogate.evaluation.extrapolation import Extrapolation, extrapolate
from surrogate.evaluation.shown_sample import find_example, tip_measures
from surrogate.evaluation.stress_errors import StressMeasures, measure_stresses
from surrogate.inference.calibration import fit_fast_certificate, fit_intervals
from surrogate.inference.loading import load
from surrogate.inference.surrogate import Surrogate
from surrogate.networks.unet import parameter_count
from surrogate.probabilistic.calibration import CalibrationMeasures, measure_calibration
from surrogate.probabilistic.distribution import Distribution
from surrogate.probabilistic.stochastic_passes import PASSES
from surrogate.runs.folder import RunFolder
from surrogate.runs.shelf import find_run


@dataclass(frozen=True)
class Evaluation:
    """Predictions of a run on the test split beside the reference solutions.

    Attributes
    ----------
    surrogate : Surrogate
    force, reference : array, (M, n_nodes, d)
        Forces in N, displacements in m.
    distribution : Distribution
        Predicted distributions.
    measures : ErrorMeasures
        Errors of the predicted means.
    calibration : CalibrationMeasures or None
        Calibration measures of a probabilistic surrogate.
    extrapolation : Extrapolation or None
        Predictions under other loads.
    intervals : Intervals or None
        Conformal intervals.
    fast_certificate : FastCertificate or None
        Calibrated bounds of single errors.
    stress : StressMeasures or None
        Errors of von Mises stresses, if the material is a shipped one.
    content : dict
        All measures and their origin as plain data.
    example_displacement : float or None
        Tip displacement in m of the sample to show.
    """

    surrogate: Surrogate
    force: NDArray[np.float64]
    reference: NDArray[np.float64]
    distribution: Distribution
    measures: ErrorMeasures
    calibration: CalibrationMeasures | None
    extrapolation: Extrapolation | None
    intervals: Intervals | None = None
    fast_certificate: FastCertificate | None = None
    stress: StressMeasures | None = None
    content: dict[str, Any] = field(default_factory=dict)
    example_displacement: float | None = None

    @property
    def predicted(self) -> NDArray[np.float64]:
        """Predicted displacements in m, (M, n_nodes, d)."""
        return self.distribution.mean

    @property
    def example(self) -> int:
        """Number of the test sample to show: loaded at the tip, which moves as far as wanted."""
        tip = self.surrogate.geometry.tip
        nodes = np.array([tip])
        return find_example(self.force, self.reference, tip, nodes, self.example_displacement)

    def example_measures(self) -> dict[str, float]:
        """Return the tip displacement of the example in m and its relative error."""
        tip, example = self.surrogate.geometry.tip, self.example
        moved, error = tip_measures(self.predicted[example], self.reference[example], tip)
        return {"tip_displacement": moved, "relative_tip_error": error}

    def files(self, run: RunFolder) -> dict[Path, bytes]:
        """Content of the files of the evaluation in a run folder, except figures."""
        text = json.dumps(self.content, indent=1) + "\n"
        files = {run.evaluation: text.encode()}
        if self.intervals is not None:
            files[run.intervals] = self.intervals.serialised()
        if self.fast_certificate is not None:
            files[run.fast_certificate] = self.fast_certificate.serialised()
        return files


def evaluate(
    run_folder: Path,
    data: Path,
    device: str = "cpu",
    passes: int = PASSES,
    seed: int = 0,
    loads: Path | None = None,
    conformal: float | None = None,
    certify: bool = False,
    example_displacement: float | None = None,
) -> Evaluation:
    """Evaluate a run on the test split of a dataset; nothing is written.

    Parameters
    ----------
    run_folder : Path
        Run folder, or the name of a network that comes with the package.
    data : Path
        Structured dataset.
    device : str
    passes, seed : int
        Number of stochastic passes and their seed, for stochastic networks.
    loads : Path, optional
        Nodal dataset of the same body under other loads, predicted as well.
    conformal : float, optional
        Level of conformal intervals, fitted to the run's calibration split and measured on the test
        split.
    certify : bool
        Calibrate the fast certificate on the run's held-out samples, and measure its coverage on
        the test split and, not promised there, on the other loads.
    example_displacement : float, optional
        Tip displacement in m of the test sample to show, among those loaded at the tip; by default
        three quarters of the largest.

    Raises
    ------
    InputError
        If the run or the dataset is missing or damaged, or their cases differ.
    """
    run_folder = find_run(run_folder)
    run = RunFolder(run_folder)
    description = run.description()
    surrogate = load(run_folder, device)
    dataset = read_dataset(data, on_disk=True)
    require_same_body(
        Body(description.data.case, surrogate.geometry.arrays()),
        Body(dataset.manifest.case, dataset.geometry.arrays()),
        f"{run_folder}: trained on case '{description.run.case}', the dataset is of case "
        f"'{dataset.manifest.name}'",
        keys=("name", *BODY_KEYS),
    )
    if len(dataset.test) == 0:
        raise InputError(f"{data}: no test samples in it")
    force, reference = dataset.nodal_test.force, dataset.nodal_test.displacement
    intervals = None
    if conformal is not None:
        intervals = fit_intervals(surrogate, dataset, conformal, passes, seed)
    fast = fit_fast_certificate(surrogate, dataset, passes, seed) if certify else None
    distribution = surrogate.predict_distribution(force, passes, seed)
    evaluation = Evaluation(
        surrogate,
        force,
        reference,
        distribution,
        measure(force, distribution.mean, reference, surrogate.geometry.tip),
        _calibration(surrogate, distribution, reference),
        None if loads is None else extrapolate(surrogate, loads, passes, seed),
        intervals,
        fast,
        measure_stresses(surrogate, distribution.mean, reference),
        example_displacement=example_displacement,
    )
    epochs, seconds = run.training_effort()
    content = evaluation.content
    content |= {
        "run": description.run.name,
        "case": description.run.case,
        "recipe": description.run.recipe,
        "likelihood": description.run.likelihood,
        "seed": description.run.seed,
        "data_digest": dataset.manifest.digest,
        "trained_on_this_data": dataset.manifest.digest == description.data.digest,
        "trainable_parameters": parameter_count(surrogate.network),
        "training_seconds": seconds,
        "epochs": epochs,
        "test": evaluation.measures.plain(),
        "example": evaluation.example_measures(),
        "torch": torch.__version__,
        "machine": f"{platform.machine()}, {torch.get_num_threads()} threads, {device}",
    }
    if evaluation.stress is not None:
        content["von_mises"] = evaluation.stress.plain()
    if dataset.info.embedding is not None:
        content["embedding_error"] = embedding_error(dataset)
    if evaluation.calibration is not None:
        drawn = {"passes": passes, "passes_seed": seed} if surrogate.is_stochastic else {}
        content["uncertainty"] = {**drawn, **evaluation.calibration.plain()}
    if evaluation.extrapolation is not None:
        content["extrapolation"] = evaluation.extrapolation.plain()
    if intervals is not None:
        free = ~surrogate.geometry.clamped
        std = surrogate.score_scale(distribution)
        content["conformal"] = intervals.measures(distribution.mean, std, reference, free)
    if fast is not None:
        spread = distribution.std
        content["fast_certificate"] = fast.measures(force, distribution.mean, reference, spread)
        if evaluation.extrapolation is not None:
            others, theirs = evaluation.extrapolation.samples, evaluation.extrapolation.predicted
            measures = fast.measures(others.force, theirs.mean, others.displacement, theirs.std)
            content["extrapolation"]["fast_certificate"] = measures
    return evaluation


def _calibration(
    surrogate: Surrogate, predicted: Distribution, reference: NDArray[np.float64]
) -> CalibrationMeasures | None:
    if not surrogate.is_probabilistic:
        return None
    return measure_calibration(
        predicted.mean, predicted.std, reference, ~surrogate.geometry.clamped
    )


def embedding_error(dataset: Dataset) -> float:
    """ē in m of the reference mapped to an embedded grid and back: the error of the embedding."""
    grid, reference = dataset.geometry.grid, dataset.nodal_test.displacement
    return float(sample_errors(grid.to_nodes(grid.to_grid(reference)), reference).mean())
