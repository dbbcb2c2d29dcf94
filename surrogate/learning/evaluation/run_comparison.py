"""Measures of several runs beside each other."""

from __future__ import annotations

import csv
import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.command_line import laid_out
from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.evaluation.run_evaluation import evaluate
from surrogate.learning.probabilistic.stochastic_passes import PASSES
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.shelf import find_run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

logger = logging.getLogger(__name__)
HEAD = ("run", "ē", "σ(e)", "largest", "tip", "parameters", "epochs", "training", "network")


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
        ē, σ(e) and the largest absolute error of a component.
    relative_tip_error : float
        Median over the samples of the relative error at the tip node.
    data : str
        Digest of the dataset of the test samples.
    unit : str
        Unit of the errors.
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
    unit: str = "m"


@dataclass(frozen=True, repr=False)
class Comparison:
    """Runs beside each other; its text is a table.

    Attributes
    ----------
    runs : tuple of Compared
    """

    runs: tuple[Compared, ...]

    def __repr__(self) -> str:
        rows: list[tuple[str, ...]] = [HEAD]
        for run in self.runs:
            errors = (run.mean_error, run.std_error, run.max_error)
            rows.append(
                (
                    run.run,
                    *(f"{error:.2e} {run.unit}" for error in errors),
                    f"{run.relative_tip_error:.2%}",
                    f"{run.parameters / 1e6:.2f} M",
                    str(run.epochs),
                    f"{run.minutes:.3g} min",
                    run.network,
                )
            )
        return laid_out(rows)

    def csv(self) -> str:
        """Return the table as comma-separated values; errors in the unit of their row."""
        text = StringIO()
        names = [field.name for field in fields(Compared)]
        writer = csv.DictWriter(text, names, lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(run) for run in self.runs)
        return text.getvalue()

    def plot(self) -> Figure:
        """Draw mean error, mean and standard deviation, and largest error of every run."""
        from surrogate.figures.comparison_figure import comparison_figure

        return comparison_figure(self.runs)


@checked_arguments
def compare(
    runs: Sequence[str | Path],
    *,
    dataset: Dataset | str | Path | None = None,
    device: str = "auto",
    passes: int = PASSES,
) -> Comparison:
    """Compare runs by their evaluations, or on the test split of one dataset.

    Parameters
    ----------
    runs : sequence of str or Path
        Run folders, or names of networks that come with the package.
    dataset : Dataset, str or Path, optional
        Structured dataset on whose test split all runs are evaluated; nothing is written. Without
        it, their own evaluations are read.
    device : {"auto", "cpu", "cuda"}
    passes : int
        Number of stochastic passes of an evaluation on `dataset`.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        If a run is missing or damaged, is not evaluated (without `dataset`), or is of another body
        than the dataset.
    """
    if not len(runs):
        raise InputError("runs = []: expected one at least")
    names = [Path(run).name for run in runs]
    compared = []
    for run, name in zip(runs, names, strict=True):
        folder = RunFolder(find_run(run))
        description = folder.description()
        config = description.run
        content: Mapping[str, Any]
        if dataset is None:
            content = folder.read_evaluation()
        else:
            content = evaluate(run, dataset, device=device, passes=passes).content
        test = content["test"]
        compared.append(
            Compared(
                run=name if names.count(name) == 1 else str(run),
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
                unit=description.data.units.length,
            )
        )
    if len({run.data for run in compared}) > 1:
        logger.warning(
            "the runs are evaluated on different datasets; --data DIR evaluates all on one"
        )
    return Comparison(tuple(compared))
