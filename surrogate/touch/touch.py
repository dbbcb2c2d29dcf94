r"""Rigid tools that push a body: their forces, sought with predictions.

A surrogate predicts the displacement u of given nodal forces. The forces of a tool are sought:
normal to it, and such that no node of the surface enters it (`surrogate.touch.linear_contact`).
Around a prediction the body is taken for linear, :math:`u ≈ u_k + C (f - f_k)`. A prediction with
the forces of this linear body is the next :math:`u_k`, and tells what C lacks
(`surrogate.touch.linear_body`); it is the last one if nodes are where the tool wants them. Where
that does not converge, the tool enters the body in steps. Frames that follow one another begin at
the last one, bend as the frames before did (`surrogate.touch.bend`), and begin again from rest if
that fails. A body that the contact alone keeps from snapping has no stable displacement under the
forces of the tool, and so no prediction: then Newton's method finds it together with the contact
(`surrogate.touch.contact_newton`). So it does where a prediction is estimated to be wrong
(`surrogate.touch.defect_correction`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.arguments.checked_arguments import checked_arguments
from shared_schema.common.arguments.read_only import read_only
from shared_schema.common.errors import WorkError
from shared_schema.tools import Contact, Tool, require_outside
from surrogate.certify.correction import Correction
from surrogate.descent.aim import require_positive
from surrogate.descent.driven_body import longest
from surrogate.touch.bend import Bend
from surrogate.touch.body import Beside, Body, LoadedBody, Predict
from surrogate.touch.contact_newton import ContactNewton
from surrogate.touch.defect_correction import ROUGHLY, DefectCorrection
from surrogate.touch.halved_steps import halved_steps
from surrogate.touch.linear_body import LinearBody
from surrogate.touch.linear_contact import linear_contact

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

TOLERANCE = 1e-3  # of frames, of the largest displacement
INSIDE = 1e-3  # of the body's size: depth of a node that is an error
CLOSE = 1e-3  # of the same: movement of the last step towards a reaction
MOST = 30  # predictions of one step
LARGER = 2.0  # of depths and distances that a full step may leave
SHORTEST = 1 / 8  # part of a step


@dataclass(frozen=True)
class TouchFrame(Contact):
    """A body that is pushed by a tool: its forces, without the load beside them, and more.

    Attributes
    ----------
    displacement : array, (n_nodes, d)
        In m.
    apart : float
        Largest distance in m to the surface of the tool of a node that bears a force.
    predictions : int
        Number of predictions that it took.
    correction : Correction or None
        How the finite elements' equilibrium was found, if it is that (`Touch.correct`).
    """

    displacement: Array
    apart: float
    predictions: int
    correction: Correction | None = None


class Touch:
    """A body that tools push, frame by frame.

    >>> touch = Touch(model)                                       # doctest: +SKIP
    >>> frame = touch.move(Sphere((3, 1.2), 0.3))                  # doctest: +SKIP
    >>> frame.reaction                                             # in N  # doctest: +SKIP
    >>> touch.reaction(Sphere((3, 1.199), 0.3))                    # doctest: +SKIP

    Parameters
    ----------
    model : Surrogate
    tolerance : float
        Largest depth of a node, and distance of one that bears a force, over the largest
        displacement.
    corrected : bool, optional
        Whether the predictions of a frame are corrected by what they leave unbalanced; by default,
        all but those of load series.

    Attributes
    ----------
    surface : array of int, (n,)
        Nodes of the surface that can move.

    Raises
    ------
    InputError
        If the body's material is none of the learner's, or the tolerance is not positive.
    """

    def __init__(
        self, model: Body, tolerance: float = TOLERANCE, corrected: bool | None = None
    ) -> None:
        require_positive("tolerance", tolerance)
        geometry, self.tolerance = model.geometry, tolerance
        on_surface = np.asarray(geometry.surface_nodes, np.int64)
        self.surface: Numbers = read_only(on_surface[geometry.free[on_surface].any(axis=1)])
        self._model, self._geometry = model, geometry
        self._at_rest = geometry.coordinates[self.surface]
        self._inside = INSIDE * float(np.ptp(geometry.coordinates, axis=0).max())
        self._body = LinearBody(model, self.surface)
        self._defect = DefectCorrection(model, corrected)
        self._tool: Tool | None = None
        self.let_go()

    def let_go(self) -> None:
        """Forget the last frame."""
        shape = self._geometry.coordinates.shape
        self._body.forget()
        self._defect.forget()
        self._bend = Bend(self._body, *self._at_rest.shape)
        self._force: Array = np.zeros(self._at_rest.shape)
        self._loaded, self._field = LoadedBody.of(self._model), np.zeros(shape)
        self._shown_by: object = None
        self._holds, self._tool = True, None

    @checked_arguments
    def move(
        self, tool: Tool, load: Beside = None, *, predict: Predict | None = None
    ) -> TouchFrame:
        """Predict the body with the tool where it is.

        Parameters
        ----------
        tool : Tool
            Of `shared_schema.tools`.
        load : array (n_nodes or n_points, d), str, sequence of str or CommandLoads, optional
            A load beside the forces of the tool, as that of `Surrogate.solve`: dead forces in N,
            or texts, also of pressures.
        predict : callable, optional
            The whole dead load in N to displacements in m, (n_nodes, d), with the pressures that
            act beside it; predictions of the surrogate by default.

        Raises
        ------
        InputError
            If the tool overlaps nodes that are held, is of another dimension or has the body all
            inside; or the load is wrong.
        WorkError
            If no forces are found.
        """
        loaded = self._loaded_with(tool, load)
        shows, total = predict or loaded.predict, partial(self._total, loaded)
        if predict is not None or self._shown_by is not None:
            self._defect.forget()
        self._defect.body = loaded

        def predicted(force: Array) -> Array:
            return self._defect.predicted(shows, total(force))

        if self._holds:
            search = Search(self._body, self._at_rest, self.surface, predicted)
            search.force, search.field = self._force, self._field
            search.expected = self._bend.expected(search.approach(self._tool or tool, tool))
            if predict is not self._shown_by or not loaded.is_under(self._loaded):
                search.predict(self._force)
            try:
                if predict is None and self._defect.wanted:
                    search.find(tool, max(self.tolerance, ROUGHLY))
                    felt = partial(felt_at, self.surface[search.force.any(axis=1)], search.field)
                    change = self._defect.improve(search.field, total(search.force), felt)
                    search.field = search.field + change
                search.find(tool, self.tolerance)
                if predict is None and self._defect.is_far(search.field, total(search.force)):
                    raise WorkError("predictions are too far from equilibrium")
            except WorkError:
                pass
            else:
                self._shown_by = predict
                if search.lack is not None:
                    effect = (search.field - self._field)[self.surface]
                    self._bend.learn(search.lack, search.force - self._force, effect)
                return self._frame(tool, loaded, search.field, search.force, search.predictions)
        frame = self._corrected(tool, loaded)
        force = total(frame.force[self.surface])
        self._holds = loaded.is_stable(frame.displacement, force)
        if self._holds and predict is None:
            self._holds = not self._defect.misses(frame.displacement, force)
        return frame

    @checked_arguments
    def correct(self, tool: Tool, load: Beside = None) -> TouchFrame:
        """Find the equilibrium of the finite elements with the tool, beginning at the last frame.

        Raises
        ------
        InputError
            As `move`.
        WorkError
            If no stable equilibrium is found.
        """
        return self._corrected(tool, self._loaded_with(tool, load))

    def _corrected(self, tool: Tool, loaded: LoadedBody) -> TouchFrame:
        try:
            found, force = self._newton.find(tool, loaded, self._field, self._force)
        except WorkError:
            if not self._force.any():
                raise
            self.let_go()
            found, force = self._newton.find(tool, loaded, self._field, self._force)
        self._shown_by = self._newton
        return self._frame(tool, loaded, found.displacement.copy(), force, 0, found)

    def _total(self, loaded: LoadedBody, on_surface: Array) -> Array:
        """The whole dead load in N with the forces of a tool on the surface, (n, d)."""
        force = np.zeros(self._geometry.coordinates.shape)
        force[self.surface] = on_surface
        return loaded.with_forces(force)

    @cached_property
    def _newton(self) -> ContactNewton:
        return ContactNewton(self._model.equilibrium, self.surface)

    def _loaded_with(self, tool: Tool, load: Beside) -> LoadedBody:
        """The body under the load beside a tool, which can come to its place."""
        require_outside(tool, self._geometry.coordinates, self._geometry.free)
        return LoadedBody.of(self._model, load)

    def _frame(
        self,
        tool: Tool,
        loaded: LoadedBody,
        field: Array,
        on_surface: Array,
        predictions: int,
        correction: Correction | None = None,
    ) -> TouchFrame:
        """Keep what is found, and describe it."""
        self._force, self._field, self._loaded, self._tool = on_surface, field, loaded, tool
        geometry, force = self._geometry, np.zeros(field.shape)
        force[self.surface] = on_surface
        gap = tool.gap(geometry.coordinates + field)
        depth = max(0.0, -float(gap.min()))
        if depth > self._inside:
            self.let_go()
            raise WorkError(
                f"a node is {geometry.units.written(depth)} inside the tool, expected one that "
                "comes from outside of the body"
            )
        return TouchFrame(
            displacement=field.copy(),
            force=force,
            penetration=depth,
            apart=float(np.abs(gap[force.any(axis=1)]).max(initial=0.0)),
            predictions=predictions,
            correction=correction,
        )

    @checked_arguments
    def reaction(self, tool: Tool) -> Array:
        """Resultant in N, (d,), of a tool close to that of the last frame: no prediction is made.

        The body is linear around the last frame, by its compliance or, if that gives no forces, by
        a step of Newton's method.
        """
        x = self._at_rest + self._field[self.surface]
        body, force = self._body, self._force
        found = linear_contact(body, tool, x, force, settled=CLOSE) if self._holds else None
        if found is None:  # of a body that the contact holds
            last = self._tool or tool
            return self._newton.reaction(tool, last, self._loaded, self._field, force)
        return np.asarray(found.sum(axis=0))


def felt_at(nodes: Numbers, field: Array, change: Array) -> float:
    """Largest change of a field at some nodes over the largest displacement there, both in m.

    The tool is rigid: where it touches, the forces would change by about that part.
    """
    return longest(change[nodes]) / (longest(field[nodes]) or 1.0)


class Search:
    """A search for the forces of a tool, from those of a body at rest or of the last frame.

    Parameters
    ----------
    body : LinearBody
    at_rest : array, (n, d)
        Undeformed positions of the surface in m.
    surface : array of int, (n,)
        Its nodes.
    predicted : callable
        Forces of the tool on the surface in N, (n, d), to displacements in m, (n_nodes, d).

    Attributes
    ----------
    force : array, (n, d)
        Forces on the surface in N.
    field : array, (n_nodes, d)
        The displacement in m under these.
    predictions : int
    expected : array, (n, d)
        Displacement in m of the surface that is expected of the first step, beyond the linear one.
    lack : array, (n, d), or None
        What it was, if the search has begun with a step.
    """

    force: Array
    field: Array

    def __init__(
        self, body: LinearBody, at_rest: Array, surface: Numbers, predicted: Predict
    ) -> None:
        self._body, self._at_rest, self._surface = body, at_rest, surface
        self._predicted, self.predictions = predicted, 0
        self.expected: Array = np.zeros(at_rest.shape)
        self.lack: Array | None = None

    def approach(self, last: Tool, tool: Tool) -> Array:
        """Changes of the distances in m to nodes that bear forces, (n,), as a tool moves."""
        bears, moved = self.force.any(axis=1), np.zeros(len(self.force))
        x = self.positions()[bears]
        moved[bears] = tool.gap(x) - last.gap(x)
        return moved

    def predict(self, force: Array) -> None:
        """Predict the field under forces on the surface."""
        self.field = self._predicted(force)
        self.force, self.predictions = force, self.predictions + 1

    def positions(self) -> Array:
        """Positions of the surface in m."""
        return np.asarray(self._at_rest + self.field[self._surface])

    def wrong(self, tool: Tool, back: float) -> float:
        """Largest depth of a node, or distance of one that bears a force, in m."""
        gap = tool.gap(self.positions()) + back
        bears = self.force.any(axis=1)
        return max(0.0, -float(gap.min()), float(np.abs(gap[bears]).max(initial=0.0)))

    def find(self, tool: Tool, tolerance: float) -> None:
        """Find the forces to a tolerance as that of `Touch`.

        Raises
        ------
        WorkError
            If none are found, however small the steps.
        """
        depth = max(0.0, -float(tool.gap(self.positions()).min()))

        def go(share: float, last: tuple[Array, Array]) -> tuple[Array, Array]:
            self.force, self.field = last
            if not self._converges(tool, (1 - share) * depth, tolerance):
                raise WorkError(f"{self.predictions} predictions")
            return self.force, self.field

        halved_steps(
            go,
            (self.force, self.field),
            lambda share: (
                f"no forces of the tool are found: it enters the body by {share:.0%} of its depth"
            ),
        )

    def _converges(self, tool: Tool, back: float, tolerance: float) -> bool:
        """Find the contact with a tool whose surface is withdrawn by a length in m."""
        body, last, is_first = self._body, self.predictions + MOST, True
        while True:
            wrong = self.wrong(tool, back)
            if wrong <= tolerance * float(np.abs(self.field).max()):
                return True
            force, x = self.force, self.positions()
            expected = 0.0 if self.predictions else self.expected
            wanted = linear_contact(body, tool, x + expected, force, back)
            if wanted is None or self.predictions >= last:
                return False
            part = 1.0
            while True:
                self.predict(force + part * (wanted - force))
                if not np.isfinite(self.field).all():
                    return False
                lack = body.learn(self.force - force, self.positions() - x)
                if self.predictions == 1:
                    self.lack = lack
                if is_first or self.wrong(tool, back) <= LARGER * wrong:
                    break
                part /= 2
                if part < SHORTEST or self.predictions >= last:
                    return False
            is_first = False
