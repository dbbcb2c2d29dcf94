"""Measures of several runs beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from surrogate.evaluation.evaluate import evaluate
from surrogate.probabilistic.stochastic_passes import PASSES
from surrogate.runs.folder import RunFolder
from surrogate.runs.shelf import find_run


@dataclass(frozen=True)
class Compared:
    """A run and its errors.

    Attributes
    ----------
    run : str
        Last part of its path; the whole path if another run has the same.
    network : str
        Architecture and likelihood.
    parameters, epochs : int
        Number of trainable parameters, and of epochs.
    minutes : float
        Time of the training in min.
    samples : int
        Number of test samples.
    mean_error, std_error, max_error : float
        ē, σ(e) and the largest absolute error of a component, in m.
    relative_tip_error : float
        Median over the samples of the relative error at the tip node.
    data : str
        Digest of the dataset of the test samples.
    """

    run: str
    network: str
    parameters: int
    epochs: int
    minutes: float
    samples: int
    mean_error: float
    std_error: float
    max_error: float
    relative_tip_error: float
    data: str


def compare(
    runs: Sequence[Path], data: Path | None = None, device: str = "cpu", passes: int = PASSES
) -> list[Compared]:
    """Compare runs by their evaluations, or on the test split of one dataset.

    Parameters
    ----------
    runs : sequence of Path
        Run folders, or names of networks that come with the package.
    data : Path, optional
        Structured dataset on whose test split all runs are evaluated; nothing is written. Without
        it, their own evaluations are read.
    device : str
    passes : int
        Number of stochastic passes of an evaluation on `data`.

    Raises
    ------
    InputError
        If a run is missing or damaged, is not evaluated (without `data`), or is of another body
        than the dataset.
    """
    names = [run.name for run in runs]
    compared = []
    for run in runs:
        folder = RunFolder(find_run(run))
        config = folder.description().run
        if data is None:
            content = folder.read_evaluation()
        else:
            content = evaluate(run, data, device, passes).content
        test = content["test"]
        compared.append(
            Compared(
                run=run.name if names.count(run.name) == 1 else str(run),
                network=f"{config.architecture}; {config.likelihood.replace('_', ' ')}",
                parameters=content["trainable_parameters"],
                epochs=content["epochs"],
                minutes=content["training_seconds"] / 60,
                samples=test["samples"],
                mean_error=test["mean_error"],
                std_error=test["std_error"],
                max_error=test["max_error"],
                relative_tip_error=test["relative_tip_error_median"],
                data=content["data_digest"],
            )
        )
    return compared
