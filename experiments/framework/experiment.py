"""Experiments, where they are measured, and what they find."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

from experiments.framework.record import Claim, Comparison, DatasetRecord, RunRecord, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Place = TypeVar("Place", bound="Setting")


@dataclass
class Findings:
    """What an experiment finds, figures in memory included.

    Attributes
    ----------
    tables : list of Table
    comparisons : list of Comparison
        Numbers beside the paper's.
    claims : list of Claim
        Statements of the paper.
    figures : dict of str to (Figure, str)
        Figures and their captions, by name.
    numbers : dict
        Measured numbers as plain data.
    finished : bool
        False if the next start goes on with it.
    """

    tables: list[Table] = field(default_factory=list)
    comparisons: list[Comparison] = field(default_factory=list)
    claims: list[Claim] = field(default_factory=list)
    figures: dict[str, tuple[Figure, str]] = field(default_factory=dict)
    numbers: dict[str, Any] = field(default_factory=dict)
    finished: bool = True


class Setting:
    """Where experiments are measured: data, device and time; each kind of them has its own.

    Attributes
    ----------
    seed : int
        Seed of everything that is drawn.
    deadline : float
        Value of `time.monotonic` at which the measurement has to end.
    """

    seed: int = 0
    deadline: float = math.inf

    @property
    def seconds_left(self) -> float:
        """Time left in s."""
        return self.deadline - time.monotonic()

    def until(self, deadline: float) -> Self:
        """Return the same setting with another deadline."""
        result = copy(self)
        result.deadline = deadline
        return result

    def configuration(self) -> dict[str, Any]:
        """Scale or options, for the record."""
        return {}

    def machine(self) -> dict[str, Any]:
        """Describe the machine, for the record."""
        return {}

    def fingerprint(self, experiment: Experiment[Any]) -> str:
        """Digest of all that the findings depend on.

        Raises
        ------
        InputError
            If a dataset is missing.
        """
        raise NotImplementedError

    def prepare(self, experiment: Experiment[Any]) -> None:
        """Make what an experiment needs and may take long, such as trained networks."""

    def used_datasets(self, experiment: Experiment[Any]) -> dict[str, DatasetRecord]:
        """Entries of the datasets that an experiment uses, for the record."""
        return {}

    def used_runs(self, experiment: Experiment[Any]) -> dict[str, RunRecord]:
        """Entries of the trained networks that an experiment uses, for the record."""
        return {}


@dataclass(frozen=True)
class Experiment(Generic[Place]):
    """A measurement: a study of the paper or beyond it, a benchmark, or a step on a GPU.

    Attributes
    ----------
    name : str
    title : str
    question : str
        One or two sentences for the report.
    measure : callable
        Function that finds the answer in a setting.
    labels : tuple of str
        Labels of its tables and figures in the paper's source.
    datasets : tuple of str
        Names of the datasets that it needs besides those of its runs, or patterns.
    runs : tuple of str
        Names of the trained networks that it needs, or patterns such as ``beam3d-c*``.
    times : bool
        True if it measures times, which depend on the device.
    seconds : float
        Time that it may take, over all starts.
    """

    name: str
    title: str
    question: str
    measure: Callable[[Place], Findings]
    labels: tuple[str, ...] = ()
    datasets: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()
    times: bool = False
    seconds: float = math.inf
