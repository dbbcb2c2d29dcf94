r"""Grips: places of a body that are held at given displacements, and the forces that hold them.

A surrogate predicts the displacement u of given nodal forces. Of a grip the displacement
:math:`\bar u` of some components H is given, and the forces g there are sought, beside a load f:

.. math:: r(g) = \bar u - u_H(f + g) = 0

Broyden's method needs predictions alone. With the change s of the forces and y of the residual's
negative in a step,

.. math:: s = B r, \qquad B ← B + \frac{(s - B y) \, s^T B}{s^T B y}, \qquad
          B_0 = \big((K^{-1})_{HH}\big)^{-1}

The stiffness of the grip at rest, :math:`B_0`, follows from the columns of :math:`K^{-1}`. Where a
step makes the residual larger, a part of it is taken; where that does not help, B is measured by
small changes of the forces, and the displacement is applied in steps. Frames that follow one
another begin at the forces of the last one; between them, what it has left unbalanced corrects the
predictions (`surrogate.touch.defect_correction`). Where no forces are found, Newton's method finds
the body with its grips (`surrogate.touch.held_newton`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shared_schema.common.arguments.checked_arguments import checked_arguments, require_type
from shared_schema.common.arguments.real_numbers import real_numbers
from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.common.errors import InputError, WorkError
from surrogate.certify.correction import Correction
from surrogate.mechanics.quadratic import QuadraticEquilibrium
from surrogate.touch.body import Body, Predict, load_beside
from surrogate.touch.defect_correction import DefectCorrection
from surrogate.touch.held_newton import HeldNewton

Array = NDArray[np.float64]
Held: TypeAlias = Mapping[str, Sequence[float | None]] | Sequence[str]

TOLERANCE = 1e-6  # residual over the largest held displacement
ACCEPTED, SLOW = 1e-4, 0.5  # residual that will do, once a step leaves so large a part of it
MOST = 40  # predictions of one step
LARGER = 1.5  # of residuals that a full step may leave
SHORTER, SHORTEST = 1 / 3, 1e-2  # parts of a step
FEW, SMALL = 12, 1e-3  # components for which B is measured, by so small a part of a step
SMALLEST = 1 / 64  # part of the displacement that a step applies
COLUMNS = 64  # of K⁻¹ at once


@dataclass(frozen=True)
class GripFrame:
    """A body that is held.

    Attributes
    ----------
    displacement : array, (n_nodes, d)
        In m.
    force : array, (n_nodes, d)
        Forces of the grips on the body in N, without the load beside them.
    reactions : array, (n_places, d)
        Resultant of these forces at each place in N.
    predictions : int
        Number of predictions that it took.
    correction : Correction or None
        How the finite elements' equilibrium was found, if it is that (`Grip.correct`).
    """

    displacement: Array
    force: Array
    reactions: Array
    predictions: int
    correction: Correction | None = None


@dataclass(frozen=True)
class Shown:
    """The field in m that is shown under forces in N of grips and beside them."""

    field: Array
    grips: Array
    acting: Array
    predict: Predict | None

    def is_of(self, grips: Array, acting: Array, predict: Predict | None) -> bool:
        """Whether it is the field of these forces."""
        same = np.array_equal(grips, self.grips) and np.array_equal(acting, self.acting)
        return same and predict is self.predict


class Grip:
    """Places of a body that are held, and moved frame by frame.

    >>> grip = Grip(model, ["4,1"])                        # doctest: +SKIP
    >>> frame = grip.move([(0.02, -0.1)])                  # doctest: +SKIP
    >>> frame.reactions                                    # in N  # doctest: +SKIP

    Parameters
    ----------
    model : Surrogate
    held : sequence of str, or mapping of str to displacements
        Places of nodes, such as "4,1", and named groups of the mesh, whose nodes all move by the
        same displacement; also as ``--hold`` takes them, such as "4,1:0.02,-". A mapping from
        places to displacements in m says the same, with None for a component that stays free.
    nearest : bool
        Let places beside a node mean the nearest one.
    corrected : bool, optional
        Whether the predictions of a frame are corrected by what the last one has left unbalanced;
        by default, all but those of load series.

    Attributes
    ----------
    components : array of bool, (n_places, n_nodes, d)
        What each place holds.
    displacements : array, (n_places, d)
        Given displacements in m; 0 where none are.
    notes : tuple of str
        Nodes that places were moved to.

    Raises
    ------
    InputError
        If there is no such node or group, one is held already, or the body's material or elements
        are none of the learner's.
    """

    def __init__(
        self, model: Body, held: Held, nearest: bool = False, *, corrected: bool | None = None
    ) -> None:
        together = CommandLoads(model.geometry.loaded_body)
        components, displacements = [], []
        for text in _texts(held, model.geometry.dimension):
            before = together.moved.copy()
            together.move(text, nearest)
            components.append(together.moved & ~before)
            moved = np.where(components[-1], together.displacement, 0.0)
            displacements.append(moved[np.abs(moved).argmax(axis=0), np.arange(moved.shape[1])])
        self.components, self.displacements = np.array(components), np.array(displacements)
        self.notes = tuple(together.notes)
        self._model, self._dofs = model, np.flatnonzero(together.moved)
        self._search = ForceSearch(stiffness_at_rest(model, together.moved))
        self._defect = DefectCorrection(model, corrected)
        self._shown: Shown | None = None
        self._field: Array = np.zeros(together.moved.shape)

    @checked_arguments
    def move(
        self,
        displacements: ArrayLike,
        load: Array | None = None,
        *,
        predict: Predict | None = None,
    ) -> GripFrame:
        """Move the places to displacements from rest, and predict the body.

        Parameters
        ----------
        displacements : array, (n_places, d)
            In m; those of free components have no meaning.
        load : array, (n_nodes, d), optional
            Nodal forces in N beside those of the grips.
        predict : callable, optional
            Nodal forces in N to displacements in m, both (n_nodes, d); `Surrogate.predict` by
            default.

        Raises
        ------
        InputError
            If a shape is wrong or a number is not finite.
        WorkError
            If no forces are found.
        """
        wanted, acting = self._given(displacements, load)
        self._correct_predictions(predict)
        shows, shown, count = predict or self._model.predict, self._shown, 0
        target = wanted.ravel()[self._dofs]

        def displaced(forces: Array) -> Array:
            nonlocal shown, count
            held = np.zeros(wanted.size)
            held[self._dofs] = forces
            grips = held.reshape(wanted.shape)
            if shown is None or not shown.is_of(grips, acting, predict):
                count += 1
                total = acting + grips
                field = self._defect.corrected(np.asarray(shows(total)), total)
                shown = Shown(field, grips, acting, predict)
            return shown.field.ravel()[self._dofs]

        try:
            self._search.find(displaced, target)  # asks for the forces that it finds last
        except WorkError as error:
            try:
                return self.correct(displacements, load)
            except WorkError:
                raise error from None
        assert shown is not None
        self._shown, self._field = shown, shown.field
        return self._frame(shown.field, shown.grips, count)

    @checked_arguments
    def correct(self, displacements: ArrayLike, load: Array | None = None) -> GripFrame:
        """Find the equilibrium of the finite elements, beginning at the last frame.

        Raises
        ------
        InputError
            As `move`.
        WorkError
            If no stable equilibrium is found, or elements have points between the nodes.
        """
        wanted, acting = self._given(displacements, load)
        if not self.can_correct:
            raise WorkError("grips are not corrected on elements with points between the nodes")
        found, force = self._newton.find(wanted, acting, self._field)
        self._field, self._shown = found.displacement, None
        return self._frame(found.displacement, force, 0, found)

    def _correct_predictions(self, predict: Predict | None) -> None:
        """Take over what the last frame tells, if it shows predictions of the model."""
        last = self._shown
        if last is None or predict is not None or last.predict is not None:
            self._defect.forget()
            self._shown = None
        else:
            change = self._defect.improve(last.field, last.acting + last.grips)
            self._shown = replace(last, field=last.field + change)

    @property
    def can_correct(self) -> bool:
        """True if elements have no points between the nodes."""
        return not isinstance(self._model.equilibrium, QuadraticEquilibrium)

    @cached_property
    def _newton(self) -> HeldNewton:
        return HeldNewton(self._model.equilibrium, np.asarray(self.components.any(axis=0)))

    def _given(self, displacements: ArrayLike, load: Array | None) -> tuple[Array, Array]:
        """Displacements of the held components in m, and the load in N, (n_nodes, d) each."""
        moved = real_numbers(displacements, "displacements")
        places, _, d = self.components.shape
        if moved.shape != (places, d) or not np.isfinite(moved).all():
            raise InputError(
                f"displacements have shape {moved.shape}, expected {places} of {d} finite numbers "
                "in m, one of each place"
            )
        wanted = np.einsum("pd,pnd->nd", moved, self.components)
        return wanted, load_beside(self._model.geometry, load)

    def _frame(
        self,
        field: Array,
        force: Array,
        predictions: int,
        correction: Correction | None = None,
    ) -> GripFrame:
        reactions = np.einsum("nd,pnd->pd", force, self.components)
        return GripFrame(field, force, reactions, predictions, correction)


class ForceSearch:
    """Broyden's method for the forces of a grip; it begins where it has ended before.

    Parameters
    ----------
    stiffness : array, (m, m)
        Of the held components at rest, in N/m.

    Attributes
    ----------
    predictions : int
        Number of predictions of the last search.
    """

    def __init__(self, stiffness: Array) -> None:
        self._at_rest, self.predictions = stiffness, 0
        self.begin_at_rest()

    def begin_at_rest(self) -> None:
        """Forget where the last search has ended."""
        self._stiffness, self._is_measured = self._at_rest, True
        self._forces = self._reached = np.zeros(len(self._at_rest))

    def find(self, displaced: Predict, target: Array) -> Array:
        """Find forces in N, (m,), under which `displaced` is the target in m, the last one asked.

        Raises
        ------
        WorkError
            If none are found, however small the steps.
        """
        self.predictions, step, share = 0, 1.0, 0.0
        begin = self._reached
        while share < 1.0:
            aim = min(1.0, share + step)
            if self._converges(displaced, begin + aim * (target - begin)):
                share, step = aim, 2 * step
                continue
            if self._measures(displaced, step * float(np.abs(target - begin).max())):
                continue
            step /= 2
            if step >= SMALLEST:
                continue
            if not begin.any():
                off = f"{share:.0%} of the displacement after {self.predictions} predictions"
                raise WorkError(f"no forces are found that hold the body so: they reach {off}")
            self.begin_at_rest()
            begin, step, share = self._reached, 1.0, 0.0
        return self._forces

    def _measures(self, displaced: Predict, length: float) -> bool:
        """Measure B where the search stands, by a small force at each of a few components, once.

        The forces would move the body at rest by a part of a length in m.
        """
        if len(self._forces) > FEW or self._is_measured:
            return False
        small = SMALL * length * np.diag(self._at_rest)
        before = displaced(self._forces)
        moved = [displaced(self._forces + force) - before for force in np.diag(small)]
        self.predictions += 1 + len(moved)
        slopes = np.array(moved).T / small
        if not np.isfinite(slopes).all() or np.linalg.cond(slopes) > 1 / SMALL**2:
            return False
        self._stiffness, self._is_measured = inverse(slopes), True
        return True

    def _converges(self, displaced: Predict, target: Array) -> bool:
        """Go to a target; the state stays as it is if that fails."""
        forces, stiffness = self._forces, self._stiffness
        residual = target - displaced(forces)
        self.predictions += 1
        size = max(np.abs(target).max(), np.abs(residual).max())
        last, left = self.predictions + MOST, np.abs(residual).max()
        while left > TOLERANCE * size:
            change, part = stiffness @ residual, 1.0
            allowed = LARGER * np.linalg.norm(residual)
            while True:
                moved = part * change
                remains = target - displaced(forces + moved)
                self.predictions += 1
                stiffness = updated(stiffness, moved, residual - remains)
                if np.linalg.norm(remains) <= allowed:
                    break
                part, allowed = SHORTER * part, np.linalg.norm(residual)
                if part < SHORTEST or self.predictions >= last:
                    return False
            before, left = left, np.abs(remains).max()
            forces, residual = forces + moved, remains
            if left <= ACCEPTED * size and left > SLOW * before:
                break
            if self.predictions >= last:
                return False
        self._forces, self._stiffness, self._reached = forces, stiffness, target
        self._is_measured = False
        return True


def updated(stiffness: Array, change: Array, effect: Array) -> Array:
    """Broyden's update of an inverse: the same, but for the effect of a change of the forces."""
    response = stiffness @ effect
    slope = float(change @ response)
    if not np.isfinite(effect).all() or abs(slope) <= 1e-3 * float(change @ change):
        return stiffness
    return stiffness + np.outer(change - response, change @ stiffness) / slope


def inverse(matrix: Array) -> Array:
    """Inverse of a matrix."""
    return np.asarray(np.linalg.inv(matrix), np.float64)


def stiffness_at_rest(model: Body, held: NDArray[np.bool_]) -> Array:
    """Inverse of the block of K⁻¹ of held components, (m, m) in N/m."""
    dofs = np.flatnonzero(held)
    block = np.empty((len(dofs), len(dofs)))
    for start in range(0, len(dofs), COLUMNS):
        some = dofs[start : start + COLUMNS]
        unit = np.zeros((len(some), held.size))
        unit[np.arange(len(some)), some] = 1.0
        response = model.equilibrium.linear_response(unit.reshape(-1, *held.shape))
        block[start : start + len(some)] = response.reshape(len(some), -1)[:, dofs]
    return inverse(block)


def _texts(held: Held, dimension: int) -> list[str]:
    """The notation of ``--hold``; InputError if nothing is held."""
    if isinstance(held, Mapping):
        parts = {place: ["-" if v is None else repr(v) for v in u] for place, u in held.items()}
        texts = [f"{place}:{','.join(values)}" for place, values in parts.items()]
    else:
        require_type("held", held, Sequence[str])
        rest = ",".join("0" * dimension)
        texts = [text if ":" in text else f"{text}:{rest}" for text in held]
    if not texts:
        raise InputError("held: no place, expected one at least")
    return texts
