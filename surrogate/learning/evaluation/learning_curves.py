r"""The learning curve of a configuration: its error over the number of training samples.

Every training has as many steps as that on all samples, so that small numbers of samples are not at
a disadvantage. Over the numbers N that were tried, a power law is fitted to the mean errors by
least squares of the logarithms:

.. math:: \bar e(N) ≈ a \, N^{-b}
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.command_line import laid_out
from shared_schema.common.errors import InputError
from shared_schema.common.files import require_writable, write_text
from shared_schema.common.units import SI, Units
from surrogate.learning.evaluation.run_evaluation import evaluate
from surrogate.learning.models.model import Model, TrainedModel
from surrogate.learning.runs.config_reader import Config, read_config
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train
from surrogate.learning.training.setup import dataset_for

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FAR = 4  # ratio of samples beyond which the power law is a guess
HALVINGS = 5  # numbers of samples, if none are given
FEWEST = 20  # samples of a training, if none are given
LARGEST_POWER = 100  # of e, in a number of samples


@dataclass(frozen=True)
class Point:
    """A training on some of the samples.

    Attributes
    ----------
    samples : int
        Number of samples, those for validation and calibration included.
    epochs : int or None
        Number of epochs; None for a model that is fitted directly.
    mean_error, std_error : float
        ē and σ(e) on the test split in m.
    minutes : float
        Time of the training in min.
    """

    samples: int
    epochs: int | None
    mean_error: float
    std_error: float
    minutes: float


@dataclass(frozen=True)
class PowerLaw:
    """Error over the number of samples, ē ≈ a N^(−b).

    Attributes
    ----------
    factor : float
        a in m.
    exponent : float
        b.
    """

    factor: float
    exponent: float

    @classmethod
    def of(cls, points: Sequence[Point]) -> PowerLaw:
        """Fit the law to two points at least."""
        samples = np.log([point.samples for point in points])
        errors = np.log([point.mean_error for point in points])
        slope, intercept = np.polyfit(samples, errors, 1)
        return cls(float(np.exp(intercept)), float(-slope))

    def error(self, samples: float) -> float:
        """Return ē in m for a number of samples."""
        return float(self.factor * samples**-self.exponent)

    def samples(self, error: float) -> float:
        """Return the number of samples for an error ē in m; infinite if more do not help."""
        if self.exponent <= 0:
            return math.inf
        power = math.log(self.factor / error) / self.exponent
        return math.exp(power) if power < LARGEST_POWER else math.inf


@dataclass(frozen=True, repr=False)
class LearningCurve:
    """Errors over the number of training samples; its text is a table.

    Attributes
    ----------
    config : Model
        Configuration of all trainings, apart from their numbers of samples and epochs.
    points : tuple of Point
        By ascending number of samples.
    law : PowerLaw or None
        Power law through the points, if there are two at least.
    units : Units
        Labels of the units of the errors.
    """

    config: Model
    points: tuple[Point, ...]
    law: PowerLaw | None
    units: Units = SI

    def __repr__(self) -> str:
        rows: list[tuple[str, ...]] = [("samples", "ē", "σ(e)", "training")]
        for point in self.points:
            mean, std = self._written(point.mean_error), self._written(point.std_error)
            rows.append((str(point.samples), mean, std, f"{point.minutes:.3g} min"))
        return laid_out(rows)

    def _written(self, error: float) -> str:
        return f"{error:.2e} {self.units.length}"

    def outlook(self, goal: float | None = None) -> Iterator[str]:
        """Say what the power law expects of more samples, and how many an error needs."""
        if self.law is None:
            return
        most = self.points[-1].samples
        yield (
            f"fitted: ē falls as N^{-self.law.exponent:.2f}; {2 * most} samples would have "
            f"{self._written(self.law.error(2 * most))}"
        )
        if goal is not None:
            needed = self.law.samples(goal)
            means = f"about {needed:.3g} training samples" if isfinite(needed) else "other means"
            far = ", far beyond those that were tried" if needed > FAR * most else ""
            yield f"ē = {self._written(goal)} needs {means}{far}"

    def as_json(self) -> str:
        """Return curve and power law as JSON."""
        content = {
            "config": self.config.plain(),
            "points": [asdict(point) for point in self.points],
            "power_law": None if self.law is None else asdict(self.law),
        }
        return json.dumps(content, indent=1, ensure_ascii=False) + "\n"

    def plot(self) -> Figure:
        """Draw the errors over the number of training samples, and the power law."""
        from surrogate.figures.learning_curve_figure import learning_curve_figure

        return learning_curve_figure(self.points, self.law, self.units)


def default_counts(training: int) -> list[int]:
    """Return a number of training samples and its halves, ascending."""
    counts = {training // 2**halving for halving in range(HALVINGS)}
    return sorted(count for count in counts if count >= min(FEWEST, training))


@checked_arguments
def learning_curve(
    config: Config,
    dataset: str | Path,
    out: str | Path,
    *,
    samples: Sequence[int] = (),
    device: str = "auto",
) -> LearningCurve:
    """Train on growing numbers of samples, and evaluate on the test split of the dataset.

    Trainings that are there are not repeated; one that was stopped is resumed.

    Parameters
    ----------
    config : Model, mapping, str or Path
        Configuration, as `surrogate.read_config` takes it.
    dataset : str or Path
        Structured dataset.
    out : str or Path
        Folder of the runs (``n100`` is that on the first 100 training samples), and of the curve:
        ``learning-curve.json`` and ``learning-curve.png``.
    samples : sequence of int
        Numbers of training samples; if empty, all of them and halves of them.
    device : {"auto", "cpu", "cuda"}

    Returns
    -------
    LearningCurve

    Raises
    ------
    InputError
        If there are fewer samples than a number asks for, or as `surrogate.train` and
        `surrogate.evaluate`.
    """
    from shared_schema.common.drawing.figure_style import save

    config, folder = read_config(config, data=dataset), Path(out)
    require_writable(folder)
    data = dataset_for(config, dataset)
    total = len(data.training)
    counts = sorted(set(samples)) or default_counts(total)
    if counts[0] < 1 or counts[-1] > total:
        wrong = counts[0] if counts[0] < 1 else counts[-1]
        raise InputError(
            f"samples {wrong}: expected 1 to {total}, the number of training samples of {dataset}",
            "samples",
        )
    points = []
    for count in counts:
        run = RunFolder(folder / f"n{count}")
        part = config_of(config, count, total)
        train(part, data, run.folder, device=device)
        test = evaluate(run.folder, data, device=device).measures
        epochs, seconds = run.training_effort()
        points.append(
            Point(
                samples=count,
                epochs=epochs if isinstance(part, TrainedModel) else None,
                mean_error=test.mean_error,
                std_error=test.std_error,
                minutes=seconds / 60,
            )
        )
    law = PowerLaw.of(points) if len(points) > 1 else None
    curve = LearningCurve(config, tuple(points), law, data.geometry.units)
    write_text(folder / "learning-curve.json", curve.as_json())
    save(curve.plot(), folder / "learning-curve.png")
    return curve


def config_of(config: Model, count: int, total: int) -> Model:
    """Return the configuration of a training on `count` of `total` samples, with as many steps."""
    changes: dict[str, int] = {"samples": count}
    if isinstance(config, TrainedModel):
        changes["epochs"] = max(1, round(config.training.epochs * total / count))
    training = config.training.model_copy(update=changes)
    name = f"{config.name}-n{count}"
    return config.model_copy(update={"name": name, "recipe": "custom", "training": training})
