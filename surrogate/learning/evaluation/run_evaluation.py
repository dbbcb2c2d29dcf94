"""Evaluation of a run on the test split: its measures, the content of ``evaluation.json``."""

from __future__ import annotations

import json
import logging
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import InputError
from surrogate.learning.data.body_check import BODY_KEYS, BodyRecord, require_same_body
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.inference.calibration import (
    fit_fast_certificate,
    fit_intervals,
    require_one_shape,
)
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.measures.error_metrics import (
    ErrorMeasures,
    StressMeasures,
    measure,
    measure_stresses,
    sample_errors,
)
from surrogate.learning.measures.extrapolation import Extrapolation, extrapolate
from surrogate.learning.measures.force_sweep import find_example, tip_measures
from surrogate.learning.networks.field_network import parameter_count
from surrogate.learning.probabilistic.calibration import CalibrationMeasures, measure_calibration
from surrogate.learning.probabilistic.distribution import Distribution
from surrogate.learning.probabilistic.stochastic_passes import PASSES
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.shelf import copy_run, find_run, require_changeable
from surrogate.mechanics.certify.conformal import Intervals
from surrogate.mechanics.certify.fast_certificate import FastCertificate
from surrogate.mechanics.statics.load import Load
from surrogate.runtime.device import choose_device

if TYPE_CHECKING:
    from matplotlib.figure import Figure

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]
AT_ONCE = 64  # samples


@dataclass(frozen=True, repr=False)
class Evaluation:
    """Predictions of a run on the test split beside the reference solutions.

    Attributes
    ----------
    run : Path
        Run folder.
    surrogate : Surrogate
    force, reference : array, (M, n_nodes, d)
        Forces in N, displacements in m.
    distribution : Distribution
        Predicted distributions.
    measures : ErrorMeasures
        Errors of the predicted means.
    example : int
        Number of the test sample to show.
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
    acting : Load
        Dead loads in N and pressures of the samples, as far as stresses depend on them.
    content : dict
        All measures and their origin as plain data, as in ``evaluation.json``.
    """

    run: Path
    surrogate: Surrogate
    force: Array
    reference: Array
    distribution: Distribution
    measures: ErrorMeasures
    example: int
    calibration: CalibrationMeasures | None
    extrapolation: Extrapolation | None
    intervals: Intervals | None
    fast_certificate: FastCertificate | None
    stress: StressMeasures | None
    acting: Load
    content: dict[str, Any]

    @property
    def predicted(self) -> Array:
        """Predicted displacements in m, (M, n_nodes, d)."""
        return self.distribution.mean

    def __repr__(self) -> str:
        return "\n".join((f"Evaluation of {self.run}", *(f"  {line}" for line in self.lines())))

    def lines(self) -> Iterator[str]:
        """Yield the most important measures, one sentence each."""
        measures, calibration = self.measures, self.calibration
        units = self.surrogate.geometry.units
        m = units.length
        yield (
            f"{measures.samples} test samples, mean error {measures.mean_error:.3e} {m} "
            f"({measures.relative_error_mean:.2%} of the largest displacement), "
            f"standard deviation of the errors {measures.std_error:.3e} {m}, "
            f"largest {measures.max_error:.3e} {m}"
        )
        if (of_grid := self.content.get("embedding_error")) is not None:
            part = f"{of_grid:.3e} {m}"
            yield f"without an error at the points of the embedded grid it would be {part}"
        if self.stress is not None:
            yield (
                f"von Mises stress, mean error {self.stress.mean_error:.3e} {units.stress} "
                f"({self.stress.relative_error:.2%} of the largest)"
            )
        if calibration is not None:
            covered = [f"{i.coverage:.1%} of {i.level:.0%}" for i in calibration.intervals]
            yield (
                f"mean predicted standard deviation {calibration.mean_std:.3e} {m}, "
                f"intervals cover {', '.join(covered)}"
            )
        certified = self.content.get("fast_certificate")
        if certified and certified["mean"]:
            wide = certified["mean"][-1]["median_width"]
            shares = _shares(certified["mean"])
            yield f"fast bounds cover {shares}, in the median {wide:.2g} times the error"
            if components := certified.get("component"):
                yield f"intervals of its size cover {_shares(components)} of the components"

    def plot(self, name: str = "errors") -> Figure:
        """Draw a figure of the evaluation; ``errors`` is that of every test sample.

        Parameters
        ----------
        name : str
            Name of a figure that `write` puts into the run folder, such as ``deformed``,
            ``error_field``, ``errors``, ``von_mises`` and ``calibration``.

        Raises
        ------
        InputError
            If the evaluation has no such figure.
        """
        from surrogate.figures.evaluation_figures import evaluation_figures

        drawn = evaluation_figures(self, RunFolder(self.run))
        if name not in drawn:
            raise InputError(f"figure '{name}': expected one of {', '.join(drawn)}")
        return drawn[name]()

    @checked_arguments
    def write(self, out: str | Path | None = None) -> Path:
        """Write measures and figures into the run folder, or into a new copy of it.

        Either all files replace those of the evaluation before, or none does.

        Parameters
        ----------
        out : str or Path, optional
            Folder of the copy; expected for a network that comes with the package.

        Returns
        -------
        Path
            Folder that is written into.

        Raises
        ------
        InputError
            If the copy's folder exists, or there is none for a network that comes with the package,
            or another process works in the folder.
        OSError
            If a file cannot be written.
        """
        from shared_schema.common.drawing.figure_style import png
        from surrogate.figures.evaluation_figures import evaluation_figures

        copy = None if out is None else Path(out)
        require_changeable(self.run, copy)
        run = RunFolder(self.run if copy is None else copy_run(self.run, copy))
        files = {run.evaluation: (json.dumps(self.content, indent=1) + "\n").encode()}
        if self.intervals is not None:
            files[run.intervals] = self.intervals.serialised()
        if self.fast_certificate is not None:
            files[run.fast_certificate] = self.fast_certificate.serialised()
        for name, draw in evaluation_figures(self, run).items():
            files[run.figures / f"{name}.png"] = png(draw())
        run.write_evaluation(files)
        return run.folder


@checked_arguments
def evaluate(
    run: str | Path,
    dataset: Dataset | str | Path,
    *,
    device: str = "auto",
    passes: int = PASSES,
    seed: int = 0,
    loads: str | Path | None = None,
    conformal: float | None = None,
    certify: bool = False,
    example_displacement: float | None = None,
) -> Evaluation:
    """Evaluate a run on the test split of a dataset; nothing is written.

    Parameters
    ----------
    run : str or Path
        Run folder, or the name of a network that comes with the package.
    dataset : Dataset, str or Path
        Structured dataset, or its folder.
    device : {"auto", "cpu", "cuda"}
    passes, seed : int
        Number of stochastic passes and their seed, for stochastic networks.
    loads : str or Path, optional
        Nodal dataset of the same body under other loads, predicted as well.
    conformal : float, optional
        Level of conformal intervals, fitted to the run's calibration split and measured on the test
        split.
    certify : bool
        Calibrate the fast certificate on the run's held-out samples, and measure its coverage on
        the test split and, not promised there, on the other loads. A run without samples keeps the
        calibration that it has. A body that has no fast certificate is evaluated without, with a
        warning.
    example_displacement : float, optional
        Tip displacement in m of the test sample to show, among those loaded at the tip; by default
        three quarters of the largest.

    Returns
    -------
    Evaluation
        Its `write` puts the measures and figures into the run folder.

    Raises
    ------
    InputError
        If the run or the dataset is missing or damaged, or their cases differ.
    """
    folder = RunFolder(find_run(run))
    target = choose_device(device).type
    surrogate = load(folder.folder, target)
    data = dataset if isinstance(dataset, Dataset) else read_dataset(dataset, on_disk=True)
    require_tested(folder, surrogate, data)
    force, reference = data.nodal_test.force.copy(), data.nodal_test.displacement.copy()
    tip, free = surrogate.geometry.tip, surrogate.geometry.free
    intervals, fast, others, calibration = None, None, None, None
    if conformal is not None:
        intervals = fit_intervals(surrogate, data, conformal, passes, seed)
    if certify and has_estimate(surrogate, data.nodal_test.load):
        fast = fast_bounds(surrogate, data, passes, seed)
    shapes = data.nodal_test.parameters
    predicted = surrogate.passes_in_shapes(force, shapes, passes, seed)
    if surrogate.is_probabilistic:
        calibration = measure_calibration(predicted.mean, predicted.std, reference, free)
    if loads is not None:
        others = extrapolate(surrogate, Path(loads), passes, seed)
    measures = measure(force, predicted.mean, reference, tip)
    acting = acting_in(data)
    stress = None
    if shapes is None:
        of = predicted.mean, reference, acting.dead, acting.following
        stress = measure_stresses(surrogate, *of)
    example = find_example(force, reference, tip, np.array([tip]), example_displacement)
    moved, error = tip_measures(predicted.mean[example], reference[example], tip)
    content = origin_of(folder, surrogate, data) | {
        "test": measures.plain(),
        "example": {"tip_displacement": moved, "relative_tip_error": error},
        "torch": torch.__version__,
        "machine": f"{platform.machine()}, {torch.get_num_threads()} threads, {target}",
    }
    if stress is not None:
        content["von_mises"] = stress.plain()
    if not surrogate.geometry.grid.points_are_nodes:
        content["embedding_error"] = embedding_error(surrogate, force, reference)
    if calibration is not None:
        drawn = {"passes": passes, "passes_seed": seed} if surrogate.is_stochastic else {}
        content["uncertainty"] = {**drawn, **calibration.plain()}
    if others is not None:
        content["extrapolation"] = others.plain()
        if fast is not None:
            theirs, samples = others.predicted, others.samples
            acts = Load.of_samples(surrogate.geometry, samples.load)
            content["extrapolation"]["fast_certificate"] = fast.measures(
                acts.dead, theirs.mean, samples.displacement, theirs.std, acts.following
            )
    if intervals is not None:
        scale = surrogate.score_scale(predicted)
        content["conformal"] = intervals.measures(predicted.mean, scale, reference, free)
    if fast is not None:
        acts = Load.of_samples(surrogate.geometry, data.nodal_test.load)
        bounds = fast.measures(acts.dead, predicted.mean, reference, predicted.std, acts.following)
        content["fast_certificate"] = bounds
    return Evaluation(
        run=folder.folder,
        surrogate=surrogate,
        force=force,
        reference=reference,
        distribution=predicted,
        measures=measures,
        example=example,
        calibration=calibration,
        extrapolation=others,
        intervals=intervals,
        fast_certificate=fast,
        stress=stress,
        acting=acting,
        content=content,
    )


def acting_in(data: Dataset) -> Load:
    """Loads of the test samples, if elements move under them in between.

    Elements without points between the nodes do not: their loads are left as they are.
    """
    loads = data.nodal_test.load
    if not data.geometry.has_points_between:
        return Load(loads)
    try:
        return Load.of_samples(data.geometry, loads)
    except InputError as error:
        logger.warning("stresses between the nodes are those under dead forces: %s", error)
        return Load(loads)


def has_estimate(surrogate: Surrogate, force: Array) -> bool:
    """Whether there are fast estimates for the body and samples of a run; if not, log why."""
    try:
        require_one_shape(surrogate)
        surrogate.fast_estimate  # noqa: B018
        Load.of_samples(surrogate.geometry, force)
    except InputError as error:
        logger.warning("no fast certificate: %s", error)
        return False
    return True


def fast_bounds(surrogate: Surrogate, data: Dataset, passes: int, seed: int) -> FastCertificate:
    """Calibrate fast bounds, or return those of a run without samples that is calibrated."""
    run, has_samples = surrogate.run, surrogate.description.data.info.train > 0
    if not has_samples and run.fast_certificate.is_file():
        return surrogate.fast_certificate
    return fit_fast_certificate(surrogate, data, passes, seed)


def require_tested(run: RunFolder, surrogate: Surrogate, dataset: Dataset) -> None:
    """Raise InputError unless a dataset is of the run's body and has test samples."""
    trained, tested = surrogate.description.data.case, dataset.body
    if not surrogate.description.run.learns:  # on any grid
        tested = dataset.at_nodes().body
    require_same_body(
        BodyRecord(trained, surrogate.geometry.arrays()),
        tested,
        f"{run.folder}: trained on case '{surrogate.description.run.case}', the dataset is of case "
        f"'{dataset.manifest.name}'",
        keys=("name", *BODY_KEYS),
    )
    if len(dataset.test) == 0:
        raise InputError(f"{dataset.folder}: no test samples in it")


def origin_of(run: RunFolder, surrogate: Surrogate, dataset: Dataset) -> dict[str, Any]:
    """Return what is evaluated on what, as plain data."""
    config, data = surrogate.description.run, surrogate.description.data
    epochs, seconds = run.training_effort()
    return {
        "run": config.name,
        "case": config.case,
        "recipe": config.recipe,
        "likelihood": config.likelihood,
        "seed": config.seed,
        "data_digest": dataset.manifest.digest,
        "trained_on_this_data": not config.learns or dataset.manifest.digest == data.digest,
        "trainable_parameters": parameter_count(surrogate.network),
        "training_seconds": seconds,
        "epochs": epochs,
    }


@torch.inference_mode()
def embedding_error(surrogate: Surrogate, force: Array, reference: Array) -> float:
    """The grid's part of ē in m: that of a network without an error at an embedded grid's points.

    Parameters
    ----------
    surrogate : Surrogate
    force, reference : array, (M, n_nodes, d)
        Forces in N, displacements in m.
    """
    network, grid, errors = surrogate.predictor.network, surrogate.geometry.grid, []
    for start in range(0, len(force), AT_ONCE):
        f, u = force[start : start + AT_ONCE], reference[start : start + AT_ONCE]
        on_grid = torch.from_numpy(grid.to_grid(u)).float().to(surrogate.network.free.device)
        linear = network.linear_response(network.on_grid(torch.from_numpy(f).to(on_grid)))
        held = network.at_nodes(on_grid, linear).transpose(1, 2).double().cpu().numpy()
        errors.append(sample_errors(held, u))
    return float(np.concatenate(errors).mean())


def _shares(bounds: Sequence[Mapping[str, float]]) -> str:
    """Shares that bounds of some levels cover, such as "89.7% of 90%, 97.0% of 95%"."""
    return ", ".join(f"{bound['coverage']:.1%} of {bound['level']:.0%}" for bound in bounds)
