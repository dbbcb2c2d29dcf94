"""What predicts a body: loads to displacements, by a load series or by a network."""

from __future__ import annotations

import warnings
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.descent.aim import Aim, UnreachedToleranceWarning
from surrogate.mechanics.series.body_series import BodySeries
from surrogate.mechanics.statics.body import Body
from surrogate.mechanics.statics.load import GivenLoad, Load
from surrogate.runtime.time_limit import require_time

Array = NDArray[np.float64]
ORDER = 5  # of the last term of a series


class Predictor(Protocol):
    """What holds, pushes and identifies a body asks for: a `Surrogate`, or a `Series`."""

    body: Body

    @property
    def has_series(self) -> bool:
        """Whether predictions are those of a load series, which leave little to correct."""

    @property
    def knows_forces(self) -> bool:
        """Whether it predicts other forces than pressures and those of actuators."""

    def respond(self, loads: Load) -> tuple[Array, Array]:
        """Predict, and tell what the last term of a load series adds.

        Parameters
        ----------
        loads : Load
            One load case, or N.

        Returns
        -------
        array, (n_nodes, d) or with N before
            Displacements in m.
        array, (N,)
            Largest displacement of the last term in m; infinite unless a series is all there is.
        """


class Series:
    """The load series of a body, which predicts without a network.

    >>> body = Body.read("data/block")                                  # doctest: +SKIP
    >>> series = Series(body)                                           # doctest: +SKIP
    >>> displacement = series.predict("tip:0,-1.5", tolerance=1e-3)     # in m  # doctest: +SKIP

    Parameters
    ----------
    body : Body
    order : int
        Order of the last term.
    terms : BodySeries, optional
        The series, if there is one already.

    Raises
    ------
    InputError
        If the learner does not know the body's elements or its material.
    """

    has_series = True
    knows_forces = True

    def __init__(self, body: Body, order: int = ORDER, terms: BodySeries | None = None) -> None:
        self.body = body
        self.terms = BodySeries(body.equilibrium, order) if terms is None else terms

    def respond(self, loads: Load) -> tuple[Array, Array]:
        """Predict, and tell what the last term adds: see `Predictor.respond`."""
        require_time()
        several = loads.cases.dead
        nodes, d = self.body.geometry.coordinates.shape
        if not len(several):
            return np.zeros((*loads.dead.shape[:-2], nodes, d)), np.empty(0)
        of_points = self.body.equilibrium.forces_at_points(several)
        found, last = self.terms.predicted(of_points, loads.following)
        return found[:, :nodes].reshape(*loads.dead.shape[:-2], nodes, d), last

    def predict(
        self,
        load: GivenLoad | Load,
        *,
        tolerance: float | None = None,
        budget: float | None = None,
    ) -> Array:
        """Predict displacements in m, (n_nodes, d), or of N load cases.

        Parameters
        ----------
        load : Load, or as `Surrogate.solve` takes it
            `Load.told_apart` makes one of N load cases.
        tolerance : float, optional
            Largest error of a node, relative to the largest displacement, to which directions drive
            the prediction.
        budget : float, optional
            Seconds that the directions of each load may take.

        Raises
        ------
        InputError
            If the load is wrong, or a tolerance or budget is not positive.
        """
        loads = load if isinstance(load, Load) else Load.of(self.body.geometry, load)
        if tolerance is None and budget is None:
            return self.respond(loads)[0]
        return driven(self, loads, Aim(tolerance, budget))


def driven(predictor: Predictor, loads: Load, aim: Aim) -> Array:
    """Predict, and drive load by load towards the equilibrium, as far as directions lead.

    Issues an `UnreachedToleranceWarning`, for the caller's caller, if they end before.
    """
    mean, last = predictor.respond(loads)
    body, each = predictor.body, loads.cases
    fields, found, missed = mean.reshape(-1, *mean.shape[-2:]), [], []
    for number, (predicted, remainder) in enumerate(zip(fields, last, strict=True)):
        displacement, descent = body.descend(each[number], predicted, aim, float(remainder))
        found.append(displacement)
        if descent.reached is False:
            missed.append(f"load {number}: {descent.refusal(body.units)}")
    if missed:
        others = f", and {len(missed) - 1} other loads" if len(missed) > 1 else ""
        warnings.warn(missed[0] + others, UnreachedToleranceWarning, stacklevel=3)
    return np.array(found).reshape(mean.shape)
