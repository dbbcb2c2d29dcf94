r"""Correction of predictions from frame to frame, by the forces that they leave unbalanced.

Frames show a prediction ũ of the forces f and a shift δ, :math:`u = ũ(f) + δ(f)`. Once the forces
are found roughly,

.. math:: δ_k = δ(f_k) - ω P(u) \, r(u), \qquad r(u) = f_{int}(u) - f_k, \qquad P(u) ≈ K(u)^{-1},

a step of defect correction (Böhmer, Hemker and Stetter, *The defect correction approach*, 1984),
with the carried compliance P (`surrogate.mechanics.descent.carried_compliance`); then the forces
are found with the new shift. Frames that follow one another are alike, and so is what the errors of
their predictions change by: under other forces the shift goes on as it did in the last step,

.. math:: δ(f) = δ_k + ρ \, (δ_k - δ_{k-1}), \qquad
          ρ = \frac{(f - f_k) · (f_k - f_{k-1})}{|f_k - f_{k-1}|^2} ∈ [-1, 3].

A body that is kept still comes to its equilibrium. Where P is too long, steps turn round; by the
part of the last one that such a step takes back, q < 0, ω = 1 / (1 − q) (Aitken's relaxation).
A step is at most as long as the motion since the last one, or as the last one itself: P is positive
definite, so that a body which its contact alone keeps from snapping is not pushed away by it.

A step takes most of the time of a frame. None is taken where it would change little: the length of
the last one, and what it changed the forces by, grow with the square of the way of the body.

The length of P r over that of u is the estimated error of a prediction. Beyond `FAR` it is no
guide, not even to a step, and frames are those of Newton's method. The error of a load series grows
so fast with the displacement that it is no guide soon after it is a hundredth. Predictions that are
not corrected are looked at again once the body has moved on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.descent.driven_body import longest
from surrogate.mechanics.descent.first_direction import first_direction
from surrogate.mechanics.statics.prediction import Predictor
from surrogate.mechanics.touch.loaded_body import LoadedBody, Predict
from surrogate.mechanics.touch.search import part_of

Array = NDArray[np.float64]
Felt: TypeAlias = Callable[[Array], float]
ROUGHLY = 1e-2  # of a search for forces: part of the displacement, before a correction
FARTHEST = 1.0  # of the largest displacement: a longer shift is given up
FURTHEST = 3.0  # largest ρ
CALM = 5e-4  # of the largest displacement: expected steps up to which none is taken
OF_FORCES = 2e-3  # of the forces: expected changes up to which none is taken
LARGE = 0.2  # of the largest displacement: a longer shift stays as it is under other forces
FAR, FAR_OF_SERIES = 0.1, 0.01  # of the largest displacement: errors of predictions beyond use
WELL = 0.1  # of these: errors up to which a body that moves on is not looked at
MOVES_ON = 0.3  # of the largest displacement: way after which it is
STILL = 0.1  # of the way between the last steps: a body that moves no farther is always corrected


class DefectCorrection:
    """The shift of one sequence of frames.

    Parameters
    ----------
    model : Predictor
    wanted : bool, optional
        Whether there is one; by default, of all predictions but those of load series.

    Attributes
    ----------
    body : LoadedBody
        The body of the next frame, under the load there.
    wanted : bool
    shift : array, (n_nodes, d)
        δ_k in m, of the last step.
    error : float
        Estimated error of the last field that was looked at, over its largest displacement.
    """

    shift: Array
    error: float

    def __init__(self, model: Predictor, wanted: bool | None = None) -> None:
        self.body, self.wanted = (
            LoadedBody.of(model),
            not model.has_series if wanted is None else wanted,
        )
        self._far = FAR_OF_SERIES if model.has_series else FAR
        self.forget()

    def forget(self) -> None:
        """Begin at rest, with no shift."""
        zero = np.zeros(self.body.model.body.geometry.coordinates.shape)
        self.shift = self._field = self._force = self._further = self._grown = zero
        self._step, self._way, self._effect = zero, 0.0, 0.0
        self.error, self._looked_at = 0.0, zero

    def predicted(self, shows: Predict, force: Array) -> Array:
        """Return a prediction with the shift, in m; a body without forces is at rest.

        The array is a new one, since `shows` may keep its own, as it may do with the forces.
        """
        shift = self.shift_under(force) if self.body.acts(force) else np.zeros_like(self.shift)
        return np.asarray(shows(force)) + shift

    def shift_under(self, force: Array) -> Array:
        """Return δ in m, (n_nodes, d), under a load in N."""
        further = force[: len(self._force)] - self._force
        return self.shift + part_of(further, self._further, FURTHEST) * self._grown

    def improve(self, field: Array, force: Array, felt: Felt | None = None) -> Array:
        """Correct the shift if that is due, and return its change in m, (n_nodes, d).

        Parameters
        ----------
        field, force : array, (n_nodes, d) and (n_nodes or n_points, d)
            Displacement in m that is shown, and the whole load in N under which it is.
        felt : callable, optional
            A change of the field in m, (n_nodes, d) → relative change of the forces that hold the
            body. Every frame is corrected if it is not given.
        """
        if not self.body.acts(force):
            self.forget()  # and what is shown has no shift
            return self.shift
        shift, way = self.shift_under(force), longest(field - self._field)
        if felt is not None and self._is_calm(way):
            return np.zeros_like(field)
        step = self._direction(field, force)
        if step is not None:
            step /= 1 - min(part_of(step, self._step), 0.0)
            step *= min(1.0, max(way, longest(self._step)) / (longest(step) or 1.0))
            if longest(shift + step) <= FARTHEST * longest(field):
                self._remember(field, force, shift + step, step)
                self._effect = longest(step) / longest(field) / CALM
                if felt is not None:
                    self._effect = max(self._effect, felt(step) / OF_FORCES)
                return step
        self.forget()
        return -shift

    def is_far(self, field: Array, force: Array) -> bool:
        """Whether a field in m that is shown under a dead load in N is no guide."""
        way = longest(field - self._looked_at)
        knows = self.error <= WELL * self._far and way <= MOVES_ON * longest(self._looked_at)
        if not self.wanted and self.body.acts(force) and not knows:
            self._direction(field, force)
        return self.error > self._far

    def misses(self, field: Array, force: Array) -> bool:
        """Whether the prediction of an equilibrium is no guide.

        Parameters
        ----------
        field, force : array, (n_nodes, d) and (n_nodes or n_points, d)
            Displacement in m, and the whole dead load in N.
        """
        if not self.body.acts(force):
            return False
        predicted = self.body.predict(force)
        return not longest(predicted - field) <= self._far * longest(field)

    def _direction(self, field: Array, force: Array) -> Array | None:
        """−P r in m, which estimates the error of a field; None if cells are inverted."""
        found = first_direction(self.body.driven_body, force, field)
        self._looked_at = field
        self.error = np.inf if found is None else longest(found) / (longest(field) or 1.0)
        return found

    def _is_calm(self, way: float) -> bool:
        """Whether a step would change little, some way from the field of the last one."""
        moves = way > STILL * self._way > 0
        return moves and self._effect * (way / self._way) ** 2 <= 1

    def _remember(self, field: Array, force: Array, shift: Array, step: Array) -> None:
        force = force[: len(field)]
        way, further = longest(field - self._field), force - self._force
        if way > STILL * self._way:
            self._way = way
        if further.any():
            goes_on = longest(shift) <= LARGE * longest(field)
            self._further, self._grown = further, goes_on * (shift - self.shift)
        self._field, self._force, self.shift, self._step = field, force, shift, step
