r"""Fast certificates: bounds of the error of a single prediction, in real time.

`surrogate.mechanics.certify.fast_estimate` estimates the error of a prediction without a
factorisation, and what the estimate leaves: its size is

.. math:: \hat e = |x| + |P \, s| / θ

with the estimate x, the forces s that it leaves out of balance, and the smallest Ritz value θ. Near
an instability the second term is the larger one. The ratio of a true error to this size is
calibrated on held-out samples: with the conformal quantile q of these ratios
(`surrogate.mechanics.certify.conformal`), or with 1 if that is larger,

.. math:: P(e \le q \hat e) \ge 1 - α

for loads like theirs. Unlike a conformal interval of fixed width, the bound is as wide as a load
needs. There is a q for the mean error e (the paper's e_m), and one for the largest error of a node.
A prediction that is unlike the held-out samples, or whose state is not stable, has no bound
(`surrogate.mechanics.certify.calibrated_range`): all are infinite, and it is never certified.

A network that predicts standard deviations knows where on the body its error is large, but not how
large it is under loads unlike those of its training. The estimate knows that. Intervals of single
components have the network's shape and the estimate's size,

.. math:: |u_i - μ_i| \le q \, \hat e \, σ_i / \bar σ

with the mean :math:`\bar σ` over the body, and the q with which they hold the wanted share of all
components of the held-out samples. Here :math:`\hat e` is the size of the estimate x alone.

The held-out samples are the calibration and validation samples of the run. Training looks at the
latter to stop early only; a run that does so leaves them out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from shared_schema.common.arguments import hold_read_only
from shared_schema.common.errors import InputError
from shared_schema.common.units import SI, Units
from surrogate.mechanics.certify.calibrated_range import LEAST_STIFFNESS, CalibratedRange
from surrogate.mechanics.certify.conformal import conformal_quantile
from surrogate.mechanics.certify.fast_estimate import FastEstimate
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.runtime.tensor_file import load_tensors, serialised

ESTIMATE = {"estimate": "conjugate gradients"}  # ratios belong to it
LEAST = 2.0  # least q
LEVELS = (0.9, 0.95)  # whose coverage is measured
MEASURES = ("mean", "largest")
COMPONENT = "component"  # of networks that predict standard deviations
KEPT = 1001  # quantiles of the ratios of single components
RANGE = "range_of_"  # prefix of the names of the calibrated range's values in a file
NO_RANGE = (
    "the calibration of an earlier version does not say what it holds for, expected that of "
    "'surrogate evaluate RUN --data DIR --certify'"
)
Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Bounds:
    """Estimated error of one prediction, and bounds that each hold with some probability.

    Those of N predictions have N as the first axis of every array.

    Attributes
    ----------
    error : array, (n_nodes, d) or (N, n_nodes, d)
        Estimate of the predicted minus the true displacement in m; infinite if a cell is inverted.
    level : float
        Probability 1 − α.
    mean, largest : array, () or (N,)
        Bounds of the mean absolute component and of the largest error of a node in m; infinite
        where there is none.
    reasons : tuple of str or None
        Why a prediction has no bound; None if it has. One entry for each prediction.
    half_width : array, (n_nodes, d) or (N, n_nodes, d), or None
        Half widths in m of the intervals of all components, which hold the share `level`.
    units : Units
        Their labels, for messages.
    """

    error: Array
    level: float
    mean: Array
    largest: Array
    reasons: tuple[str | None, ...] = (None,)
    half_width: Array | None = None
    units: Units = SI

    def certified(self, tolerance: float) -> NDArray[np.bool_]:
        """True where the bound `largest` is at most `tolerance` in m."""
        return np.asarray(self.largest <= tolerance) & np.isfinite(self.largest)

    def __repr__(self) -> str:
        """Describe the error."""
        return f"Bounds({self.summary()})"

    def summary(self) -> str:
        """Describe the bounds in a line."""
        count = len(self.reasons)
        if count != 1:
            refused = count - self.reasons.count(None)
            return (
                f"{count} predictions with bounds of probability {self.level:g}, {refused} without"
            )
        if self.reasons[0] is not None:
            return "no bound of the error"
        length = self.units.written
        return (
            f"error at most {length(float(self.mean))} in the mean and "
            f"{length(float(self.largest))} at any node, each with probability {self.level:g}"
        )

    def refusal(self, tolerance: float) -> str | None:
        """Say why the prediction, or which of several, is not certified; None if all are."""
        for number, (reason, bound) in enumerate(
            zip(self.reasons, np.atleast_1d(self.largest), strict=True)
        ):
            if reason is None and not bound <= tolerance:
                most = self.units.written(tolerance)
                reason = f"bound of the error {self.units.written(bound)} > {most}"
            if reason is not None:
                return reason if len(self.reasons) == 1 else f"prediction {number}: {reason}"
        return None


@dataclass(frozen=True)
class FastCertificate:
    """Calibrated bounds of errors. Its arrays are read-only.

    Attributes
    ----------
    estimate : FastEstimate
    ratios : dict of str to array, (n,)
        Ratios of true and estimated errors of the held-out samples, by measure: "mean" and
        "largest". For a network that predicts standard deviations also "component": quantiles of
        the ratios of single components, at `KEPT` equal steps.
    calibrated : CalibratedRange or None
        What the held-out samples had in common. Without it no prediction has a bound.
    """

    estimate: FastEstimate
    ratios: dict[str, Array]
    calibrated: CalibratedRange | None = None

    def __post_init__(self) -> None:
        hold_read_only(self)

    @classmethod
    def fit(
        cls,
        estimate: FastEstimate,
        force: Array,
        predicted: Array,
        truth: Array,
        std: Array | None = None,
        following: FollowingLoads | None = None,
    ) -> FastCertificate:
        """Calibrate on samples that were not trained on, (n, n_nodes, d) in N, m, m and m.

        Those whose predicted state is not stable are left out, since such states have no bound.
        Forces are dead ones; pressures that follow the surface are given beside them.
        """
        estimated, rest, softest = estimate.with_stability(force, predicted, following)
        stable = softest > LEAST_STIFFNESS
        pressures = None if following is None else following.amplitudes[stable]
        estimated, rest, softest = estimated[stable], rest[stable], softest[stable]
        force, predicted, truth = force[stable], predicted[stable], truth[stable]
        std = None if std is None else std[stable]
        error = predicted - truth
        found = with_rest(estimated, rest, softest)
        ratios = {
            name: np.divide(e, found[name], out=np.zeros(len(e)), where=e > 0)
            for name, e in sizes(error).items()
        }
        if std is not None:
            scale = with_size(std, sizes(estimated)["mean"])
            of_components = np.abs(error)[scale > 0] / scale[scale > 0]
            ratios[COMPONENT] = np.quantile(of_components, np.linspace(0, 1, KEPT))
        nodal = force[:, : predicted.shape[1]]
        known = CalibratedRange.of(nodal, predicted, estimated, softest, pressures)
        return cls(estimate, ratios, known)

    @property
    def knows_components(self) -> bool:
        """Whether there are intervals of single components."""
        return COMPONENT in self.ratios

    def half_widths(self, error: Array, std: Array, level: float) -> Array:
        """Half widths in m of the intervals of all components, which hold the share `level`.

        Parameters
        ----------
        error, std : array, (N, n_nodes, d)
            Estimated errors, of `estimate`, and predicted standard deviations in m.
        level : float
        """
        factor = np.interp(level, np.linspace(0, 1, KEPT), self.ratios[COMPONENT])
        return float(factor) * with_size(std, sizes(error)["mean"])

    def inside(
        self, force: Array, predicted: Array, truth: Array, std: Array, level: float
    ) -> NDArray[np.bool_]:
        """Components of every sample inside their intervals of the level, (N, n_nodes, d)."""
        half = self.half_widths(self.estimate(force, predicted), std, level)
        return np.asarray(np.abs(predicted - truth) <= half)

    def factor(self, level: float, measure: str = "mean") -> float:
        """Return q of a level 1 − α, at least `LEAST`.

        Where the steps converge x is the error. So the samples may say that a bound needs more than
        the size of the estimate, but never that less will do; and loads that are unlike them in
        ways that no check sees need somewhat more.

        Raises
        ------
        ValueError
            If the level is not between 0 and 1, or there were too few samples for it.
        """
        return max(LEAST, float(conformal_quantile(self.ratios[measure], level)))

    def bounds(self, error: Array, rest: Array, softest: Array, level: float) -> dict[str, Array]:
        """Bounds in m that hold with the probability `level` each, by measure: (N,).

        Parameters
        ----------
        error, rest, softest : array
            Of `FastEstimate.with_stability`.
        level : float

        Raises
        ------
        ValueError
            As `factor`.
        """
        found = with_rest(error, rest, softest)
        return {name: self.factor(level, name) * e for name, e in found.items()}

    def certify(
        self,
        forces: Array,
        predicted: Array,
        level: float,
        std: Array | None = None,
        following: FollowingLoads | None = None,
    ) -> Bounds:
        """Bound the error of one prediction, or of N.

        Parameters
        ----------
        forces, predicted : array, (n_nodes, d) or (N, n_nodes, d)
            Dead loads in N, those between the nodes after the nodal ones, and displacements in m.
        level : float
            Probability 1 − α of each bound.
        std : array of the same shape, optional
            Predicted standard deviations in m, which intervals of single components need.
        following : FollowingLoads, optional
            Pressures of the load cases.

        Raises
        ------
        ValueError
            As `factor`.
        """
        shape = predicted.shape
        f, u = (field.reshape(-1, *field.shape[-2:]) for field in (forces, predicted))
        error, rest, softest = self.estimate.with_stability(f, u, following)
        reasons = self.refusals(f, u, error, softest, following)
        refused = np.array([reason is not None for reason in reasons], dtype=bool)
        found: dict[str, Any] = {
            name: np.where(refused, np.inf, bound).reshape(shape[:-2])
            for name, bound in self.bounds(error, rest, softest, level).items()
        }
        half = None
        if std is not None and self.knows_components:
            half = self.half_widths(error, std.reshape(u.shape), level)
            half[refused] = np.inf
            half = half.reshape(shape)
        bounds = Bounds(error.reshape(shape), level, **found, reasons=reasons, half_width=half)
        return replace(bounds, units=self.estimate.units)

    def refusals(
        self,
        force: Array,
        predicted: Array,
        error: Array,
        softest: Array,
        following: FollowingLoads | None = None,
    ) -> tuple[str | None, ...]:
        """Say of each prediction why it has no bound, as `CalibratedRange.refusals`."""
        if self.calibrated is None:
            return (NO_RANGE,) * len(force)
        body = self.estimate.loadable, self.estimate.units
        pressures = None if following is None else following.amplitudes
        nodal = force[:, : predicted.shape[1]]
        return self.calibrated.refusals(nodal, predicted, error, softest, *body, pressures)

    def measures(
        self,
        force: Array,
        predicted: Array,
        truth: Array,
        std: Array | None = None,
        following: FollowingLoads | None = None,
    ) -> dict[str, Any]:
        """Coverage of the bounds on other samples, and their median ratio to the true error.

        The result is plain data, by measure and level. A level that there were too few samples for
        is left out. `refused` is the share of the samples that have no bound; coverage is that of
        the product of factor and estimate for all of them.
        """
        error, rest, softest = self.estimate.with_stability(force, predicted, following)
        refusals = self.refusals(force, predicted, error, softest, following)
        true_error = predicted - truth
        true = sizes(true_error)
        content: dict[str, Any] = {"samples": len(self.ratios["mean"])}
        content["refused"] = 1 - refusals.count(None) / max(len(refusals), 1)
        for name in MEASURES:
            content[name] = []
            for level in LEVELS:
                try:
                    bound = self.bounds(error, rest, softest, level)[name]
                except ValueError:
                    continue
                wide = np.median(bound[true[name] > 0] / true[name][true[name] > 0])
                covered = (true[name] <= bound).mean()
                entry = {"level": level, "coverage": float(covered), "median_width": float(wide)}
                content[name].append(entry)
        if std is not None and self.knows_components:
            magnitude, moves = np.abs(true_error), std.any(axis=0)
            content[COMPONENT] = [
                {
                    "level": level,
                    "coverage": float(
                        (magnitude <= self.half_widths(error, std, level))[:, moves].mean()
                    ),
                }
                for level in LEVELS
            ]
        return content

    def serialised(self) -> bytes:
        """Content of a file of the calibration, which `read_calibration` reads."""
        values = {name: np.sort(ratios) for name, ratios in self.ratios.items()}
        if self.calibrated is not None:
            values |= {RANGE + name: value for name, value in self.calibrated.arrays().items()}
        return serialised({name: torch.tensor(v) for name, v in values.items()}, ESTIMATE)


def sizes(error: Array) -> dict[str, Array]:
    """Mean absolute component and largest length of errors in m: (N, n_nodes, d) → (N,) each."""
    return {
        "mean": np.abs(error).mean(axis=(1, 2)),
        "largest": np.sqrt(np.einsum("nid,nid->ni", error, error).max(axis=1)),
    }


def with_rest(error: Array, rest: Array, softest: Array) -> dict[str, Array]:
    """Sizes of estimated errors and of what they leave, of `FastEstimate.with_stability`: (N,)."""
    stiffness, left = np.maximum(softest, LEAST_STIFFNESS), sizes(rest)
    return {name: size + left[name] / stiffness for name, size in sizes(error).items()}


def with_size(std: Array, size: Array) -> Array:
    """Scale standard deviations (N, n_nodes, d) to mean sizes (N,), in m."""
    mean = std.mean(axis=(1, 2))
    factor = np.divide(size, mean, out=np.zeros(len(mean)), where=mean > 0)[:, None, None]
    return np.asarray(np.multiply(std, factor, out=np.zeros_like(std), where=std > 0))


def read_calibration(path: Path) -> tuple[dict[str, Array], CalibratedRange | None]:
    """Read the ratios and the calibrated range of `FastCertificate.serialised`.

    A file of an earlier version has no range.

    Raises
    ------
    InputError
        If the file is missing or damaged, or was calibrated for another estimate.
    """
    if not path.is_file():
        raise InputError(
            f"{path}: no fast certificate in the run, expected it from 'surrogate evaluate RUN "
            "--data DIR --certify'"
        )
    tensors, metadata = load_tensors(path)
    if metadata != ESTIMATE:
        raise InputError(
            f"{path}: calibrated for the estimate of another version, expected it from 'surrogate "
            "evaluate RUN --data DIR --certify' of this one"
        )
    arrays = {name: tensor.double().numpy() for name, tensor in tensors.items()}
    known = {n.removeprefix(RANGE): v for n, v in arrays.items() if n.startswith(RANGE)}
    ratios = {name: values for name, values in arrays.items() if not name.startswith(RANGE)}
    try:
        calibrated = CalibratedRange.from_arrays(known) if known else None
    except (KeyError, ValueError):
        raise InputError(f"{path}: not a fast certificate") from None
    if set(ratios) - {COMPONENT} != set(MEASURES):
        raise InputError(f"{path}: not a fast certificate")
    return ratios, calibrated
