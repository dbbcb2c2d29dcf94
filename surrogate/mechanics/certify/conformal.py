r"""Intervals with guaranteed coverage, from errors on held-out samples (split conformal).

The score of a component of a calibration sample is :math:`s = |u - μ| / σ` (Lei et al. 2018,
Sections 2.2 and 5.2). With n samples and :math:`k = \lceil (n+1)(1-α) \rceil`, their k-th smallest
score q gives

.. math:: P(μ - q σ \le u \le μ + q σ) \ge 1 - α

for a new sample, whatever the errors' distribution and however wrong σ, as long as the samples are
exchangeable (Vovk, Gammerman and Shafer 2005). Proof: the rank of the new score among all n + 1,
ties broken at random, is uniform on 1, …, n + 1. If the rank is at most k, the score is at most q.
The rank is at most k with probability :math:`k / (n+1) \ge 1 - α`, which is the coverage itself if
no two scores are equal.

The probability is over calibration samples and new sample together. Over calibrations, the coverage
varies as Beta(k, n + 1 − k), with mean k / (n + 1), if the samples are independent and no two
scores are equal (Vovk 2012).

Samples are exchangeable, the components of one are not. So scores are ranked over samples only (a
whole field is covered if and only if its largest score is at most q):

============  =================================================  ========================
kind          score of a sample                                  covered with 1 − α
============  =================================================  ========================
marginal      that of each component; a factor q for each        each component by itself
simultaneous  the largest of its free components; one q for all  the whole field at once
============  =================================================  ========================
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from shared_schema.common.arguments import hold_read_only
from shared_schema.common.errors import InputError, first_line
from surrogate.mechanics.body.geometry import at_free, by_component, require_positive
from surrogate.runtime.tensor_file import load_tensors, serialised

Array = NDArray[np.float64]
Kind = Literal["marginal", "simultaneous"]
KINDS: tuple[Kind, ...] = ("marginal", "simultaneous")

ROUNDING = 1e-9  # (n + 1)(1 − α) above a whole number by less than this is taken as that number


def samples_needed(level: float) -> int:
    """Fewest calibration samples with a finite quantile: the smallest n with ⌈(n+1)(1−α)⌉ ≤ n."""
    return ceil(level / (1 - level) - ROUNDING)


def conformal_quantile(scores: Array, level: float) -> Array:
    """The ⌈(n+1)(1−α)⌉-th smallest of n scores: (n, ...) → (...).

    Raises
    ------
    ValueError
        If the level 1 − α is not between 0 and 1, or there are too few scores for it.
    """
    if not 0 < level < 1:
        raise ValueError(f"level is {level}, expected a number between 0 and 1")
    n = len(scores)
    k = ceil((n + 1) * level - ROUNDING)
    if k > n:
        raise ValueError(
            f"{n} calibration samples, expected at least {samples_needed(level)} for level {level}"
        )
    return np.asarray(np.partition(scores, k - 1, axis=0)[k - 1])


@dataclass(frozen=True)
class ConformalCalibration:
    """Factors on σ that make intervals cover new samples. Its array is read-only.

    Attributes
    ----------
    level : float
        Nominal coverage 1 − α.
    kind : {"marginal", "simultaneous"}
    factor : array, (n_nodes, d)
        Factor q of every component; 0 where held; in m if fitted with σ = 1.
    """

    level: float
    kind: Kind
    factor: Array

    def __post_init__(self) -> None:
        hold_read_only(self)

    @classmethod
    def fit(
        cls,
        level: float,
        kind: Kind,
        mean: Array,
        std: ArrayLike,
        reference: Array,
        free: NDArray[np.bool_],
    ) -> ConformalCalibration:
        """Fit the factors to calibration samples, used neither for training nor for testing.

        Parameters
        ----------
        level : float
            Nominal coverage 1 − α, between 0 and 1.
        kind : {"marginal", "simultaneous"}
        mean, reference : array, (n, n_nodes, d)
            μ and u in m.
        std : array, (n, n_nodes, d), or 1.0
            σ in m; 1.0 for a deterministic surrogate, whose scores are absolute errors in m.
        free : array of bool, (n_nodes, d) or (n_nodes,)
            Components that are not held, or nodes that are not clamped.

        Raises
        ------
        ValueError
            If there are too few samples for the level, or σ is not positive and finite at a free
            component.
        """
        sigma = np.broadcast_to(np.asarray(std, dtype=np.float64), mean.shape)
        require_positive(sigma, free)
        free = by_component(free, mean.shape[-1])
        scores = np.abs(reference - mean)[:, free] / sigma[:, free]
        if kind == "simultaneous":
            scores = scores.max(axis=1, keepdims=True)
        factor = np.zeros(mean.shape[1:])
        factor[free] = conformal_quantile(scores, level)
        return cls(level, kind, factor)

    def interval(self, mean: Array, std: ArrayLike) -> tuple[Array, Array]:
        """Return both ends μ ∓ qσ of the intervals in m, (..., n_nodes, d); `std` as in `fit`."""
        half = self.factor * np.asarray(std, dtype=np.float64)
        return mean - half, mean + half


@dataclass(frozen=True)
class Intervals:
    """Conformal intervals of one level, of both kinds.

    Attributes
    ----------
    level : float
        Nominal coverage 1 − α.
    samples : int
        Number of calibration samples.
    calibrations : dict
        Fitted factors by kind.
    """

    level: float
    samples: int
    calibrations: dict[Kind, ConformalCalibration]

    def bounds(self, kind: Kind, mean: Array, std: ArrayLike) -> tuple[Array, Array]:
        """Return both ends of the intervals in m, (..., n_nodes, d); `std` as in their fit."""
        return self.calibrations[kind].interval(mean, std)

    def measures(
        self, mean: Array, std: ArrayLike, reference: Array, free: NDArray[np.bool_]
    ) -> dict[str, Any]:
        """Measure coverage and mean width on other samples.

        Parameters
        ----------
        mean, reference : array, (M, n_nodes, d)
            Predicted and true displacements in m.
        std : array, (M, n_nodes, d), or 1.0
            As in `ConformalCalibration.fit`.
        free : array of bool, (n_nodes, d) or (n_nodes,)
            Components that are not held, or nodes that are not clamped.

        Returns
        -------
        dict
            Plain data, by kind: ``width`` is the mean width in m; ``coverage`` is the share of the
            free components for marginal intervals, of whole samples for simultaneous ones.
        """
        content: dict[str, Any] = {"level": self.level, "samples": self.samples}
        for kind in KINDS:
            lower, upper = self.bounds(kind, mean, std)
            inside = at_free((lower <= reference) & (reference <= upper), free)
            covered = inside if kind == "marginal" else inside.all(axis=(1, 2))
            content[kind] = {
                "coverage": float(covered.mean()),
                "width": float(at_free(upper - lower, free).mean()),
            }
        return content

    def serialised(self) -> bytes:
        """Content of a file of the intervals, which `read` reads."""
        factors = {str(kind): fitted.factor for kind, fitted in self.calibrations.items()}
        tensors = {kind: torch.tensor(factor) for kind, factor in factors.items()}
        return serialised(tensors, {"level": repr(self.level), "samples": str(self.samples)})

    @classmethod
    def read(cls, path: Path) -> Intervals:
        """Read a file of `serialised`.

        Raises
        ------
        InputError
            If the file is missing or damaged.
        """
        if not path.is_file():
            raise InputError(
                f"{path}: no conformal intervals in the run, expected them from 'surrogate "
                "evaluate RUN --data DIR --conformal LEVEL'"
            )
        tensors, metadata = load_tensors(path)
        try:
            level, samples = float(metadata["level"]), int(metadata["samples"])
            calibrations = {
                kind: ConformalCalibration(level, kind, tensors[kind].numpy()) for kind in KINDS
            }
        except (KeyError, ValueError) as error:
            raise InputError(f"{path}: not conformal intervals ({first_line(error)})") from None
        return cls(level, samples, calibrations)
