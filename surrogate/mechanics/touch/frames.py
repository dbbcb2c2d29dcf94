"""Frames of one body under a condition that moves: predicted, corrected, or found with the body.

A surrogate predicts the displacement u of given nodal forces. Where forces are unknown, predictions
are searched for those that fulfil the condition (`surrogate.mechanics.touch.search`). Frames that
follow one another begin at the forces of the last one. What is left unbalanced corrects the
predictions, once a frame (`surrogate.mechanics.touch.defect_correction`).

Where no forces are found, or their prediction is estimated to be wrong, Newton's method finds the
body together with its condition, until its forces alone hold it and predictions are right again:
beyond the load under which a column buckles, there is no stable displacement to predict. From the
last state the condition is approached in steps, which are halved where they fail. Pressures, under
which no energy tells the right step, grow with these where the body is at rest.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from dataclasses import replace
from functools import partial
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import WorkError
from surrogate.mechanics.certify.correction import Correction
from surrogate.mechanics.descent.aim import require_positive
from surrogate.mechanics.equilibrium.halved_steps import halved_steps
from surrogate.mechanics.statics.prediction import Predictor
from surrogate.mechanics.touch.condition import Condition
from surrogate.mechanics.touch.defect_correction import ROUGHLY, DefectCorrection
from surrogate.mechanics.touch.loaded_body import LinearBody, LoadedBody, Predict
from surrogate.mechanics.touch.search import Bend, ForceSearch, Shown

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
C = TypeVar("C", bound=Condition)
F = TypeVar("F")


class Frames(ABC, Generic[C, F]):
    """A body under conditions of one kind, frame by frame.

    Parameters
    ----------
    model : Surrogate, or Series
    components : array of int, (m,)
        Degrees of freedom of the points of its elements where forces are unknown.
    tolerance : float
        How far a frame may be from its condition, over the size of that.
    corrected : bool, optional
        Whether the predictions of a frame are corrected by what they leave unbalanced; by default,
        all but those of load series.

    Raises
    ------
    InputError
        If the tolerance is not positive, or the body's material is none of the learner's.
    """

    def __init__(
        self, model: Predictor, components: Numbers, tolerance: float, corrected: bool | None
    ) -> None:
        require_positive("tolerance", tolerance)
        self.tolerance, self._model = tolerance, model
        self._body = LinearBody(model.body.equilibrium, components)
        self._defect = DefectCorrection(model, corrected)
        self._begin_at_rest()

    def _begin_at_rest(self) -> None:
        """Forget the last frame."""
        self._body.forget()
        self._defect.forget()
        self._bend, self._holds = Bend(self._body), True
        field, nothing = np.zeros(self._model.body.geometry.coordinates.shape), self._body.at_rest
        self._shown, self._loaded = Shown(field, nothing, nothing), LoadedBody.of(self._model)
        self._shown_by: object = None
        self._condition: C | None = None

    @abstractmethod
    def _frame(self, predictions: int, correction: Correction | None = None) -> F:
        """Describe what is shown."""

    @abstractmethod
    def _balanced(
        self, condition: C, loaded: LoadedBody, u: Array, force: Array
    ) -> tuple[Correction, Array]:
        """Equilibrium with a condition, and the forces, (m,) in N; WorkError if there is none.

        It begins at u in m, (1, n_points, d), and forces there.
        """

    def _moved(self, condition: C, loaded: LoadedBody, predict: Predict | None) -> F:
        """Find a frame by predictions, of the surrogate or others, or else by Newton's method."""
        if self._holds:
            try:
                return self._frame(self._predicted(condition, loaded, predict))
            except WorkError as error:
                self._body.forget()  # what has led nowhere is no guide
                logger.info("%s: Newton's method goes on, which takes more time", error)
        frame, u = self._corrected(condition, loaded)
        self._defect.body, self._holds = loaded, loaded.is_stable(u)
        if self._holds and predict is None:
            dead = self._dead(loaded, self._shown.force)
            self._holds = not self._defect.misses(self._shown.field, dead)
        return frame

    def _predicted(self, condition: C, loaded: LoadedBody, predict: Predict | None) -> int:
        """Search predictions for the forces: how many it took; WorkError if they lead nowhere."""
        last, shows, defect = self._shown, predict or loaded.predict, self._defect
        if predict is not None or self._shown_by is not None:
            defect.forget()
        defect.body = loaded

        def predicted(force: Array) -> Shown:
            return self._at(loaded, defect.predicted(shows, self._dead(loaded, force)), force)

        search = ForceSearch(self._body, predicted, last)
        moved = condition.moved_from(self._condition, last.u, last.force)
        search.expected = self._bend.expected(moved)
        if predict is not self._shown_by or not loaded.is_under(self._loaded):
            search.predict(last.force)
        if predict is None and defect.wanted:
            search.find(condition, max(self.tolerance, ROUGHLY))
            now = search.shown
            dead, felt = self._dead(loaded, now.force), partial(self._felt, condition, now)
            change = defect.improve(now.field, dead, felt)
            search.shown = self._at(loaded, now.field + change, now.force)
        search.find(condition, self.tolerance)
        now = search.shown
        if predict is None and defect.is_far(now.field, self._dead(loaded, now.force)):
            raise WorkError("predictions are too far from equilibrium")
        if search.lack is not None:
            self._bend.learn(search.lack, now.force - last.force, now.u - last.u)
        self._keep(now, loaded, condition, predict)
        return search.predictions

    def _corrected(self, condition: C, loaded: LoadedBody) -> tuple[F, Array]:
        """Find the equilibrium of the finite elements, from the last state or else from rest.

        With the displacement of all points in m, (n_points, d).

        Raises
        ------
        WorkError
            If no stable equilibrium is found.
        """
        u, force = loaded.at_points(self._shown.field, loaded.load.dead)[None], self._shown.force
        if loaded.equilibrium.inverted(u)[0]:
            u, force = 0 * u, 0 * force
        try:
            found, force = self._on_the_way(condition, loaded, u, force)
        except WorkError:
            if not u.any():
                raise
            found, force = self._on_the_way(condition, loaded, 0 * u, 0 * force)
        u = found.displacement
        found = replace(found, displacement=u[: loaded.equilibrium.nodes])
        self._keep(self._at(loaded, found.displacement.copy(), force), loaded, condition, found)
        return self._frame(0, found), u

    def _on_the_way(
        self, condition: C, loaded: LoadedBody, begin: Array, force: Array
    ) -> tuple[Correction, Array]:
        """Approach the condition from a state, (1, n_points, d)."""
        u = begin.ravel()[self._body.components]

        def go(share: float, last: tuple[Correction, Array]) -> tuple[Correction, Array]:
            part = 1.0 if begin.any() or loaded.following is None else share
            given = condition.on_the_way(share, u), loaded.part(part)
            found, after = self._balanced(*given, last[0].displacement[None], last[1])
            return replace(found, iterations=last[0].iterations + found.iterations), after

        return halved_steps(go, (Correction(begin[0], "", 0, 0.0), force), condition.missing)

    def _keep(self, shown: Shown, loaded: LoadedBody, condition: C, shown_by: object) -> None:
        """Let frames go on from a state."""
        self._shown, self._loaded = shown, loaded
        self._condition, self._shown_by = condition, shown_by

    def _dead(self, loaded: LoadedBody, force: Array) -> Array:
        """The whole dead load in N with forces on the components, (m,)."""
        return loaded.with_forces(self._body.load(force[None])[0])

    def _at(self, loaded: LoadedBody, field: Array, force: Array) -> Shown:
        u = field
        if self._body.between:
            u = loaded.at_points(field, self._dead(loaded, force))
        return Shown(field, u.ravel()[self._body.components], force)

    def _felt(self, condition: C, now: Shown, change: Array) -> float:
        """How much forces would change with a change of the field in m, over their size."""
        if self._body.between:
            change = self._model.body.equilibrium.interpolated(change[None])
        moved = change.ravel()[self._body.components]
        return condition.felt(self._body, moved, now.u, now.force)
