r"""Grips: places of a body that are held at given displacements, and the forces that hold them.

A surrogate predicts the displacement u of given nodal forces. Of a grip the displacement
:math:`\bar u` of some components H is given, and the forces g there are sought, beside a load f:

.. math:: r(g) = \bar u - u_H(f + g) = 0

by Broyden's method, which needs predictions alone (`surrogate.touch.force_search`). Frames that
follow one another begin at the forces of the last one. What is left unbalanced corrects the
predictions, once a frame (`surrogate.touch.defect_correction`). Where no forces are found, or their
prediction is estimated to be wrong, Newton's method finds the body with its grips
(`surrogate.touch.held_newton`), until predictions are right again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shared_schema.common.arguments.checked_arguments import checked_arguments, require_type
from shared_schema.common.arguments.read_only import read_only
from shared_schema.common.arguments.real_numbers import real_numbers
from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.common.errors import InputError, WorkError
from surrogate.certify.correction import Correction
from surrogate.data.geometry import Geometry
from surrogate.descent.aim import require_positive
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.touch.body import Beside, Body, LoadedBody, Predict
from surrogate.touch.defect_correction import ROUGHLY, DefectCorrection
from surrogate.touch.force_search import TOLERANCE, ForceSearch, inverse
from surrogate.touch.held_newton import HeldNewton

Array = NDArray[np.float64]
Held: TypeAlias = Mapping[str, Sequence[float | None]] | Sequence[str]

COLUMNS = 64  # of K⁻¹ at once


@dataclass(frozen=True)
class GripFrame:
    """A body that is held.

    Attributes
    ----------
    displacement : array, (n_nodes, d)
        In m.
    force : array, (n_nodes or n_points, d)
        Forces of the grips on the body in N, without the load beside them; those of groups may act
        between the nodes as well.
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
    """The field in m that is shown under forces of grips on the held components in N."""

    field: Array
    grips: Array
    loaded: LoadedBody
    predict: Predict | None

    def is_of(self, grips: Array, loaded: LoadedBody, predict: Predict | None) -> bool:
        """Whether it is the field of these forces."""
        same = np.array_equal(grips, self.grips) and loaded.is_under(self.loaded)
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
    tolerance : float
        Largest error of a held component over the largest held displacement.
    corrected : bool, optional
        Whether the predictions of a frame are corrected by what they leave unbalanced; by default,
        all but those of load series.

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
        If there is no such node or group, one is held already, the tolerance is not positive, or
        the body's material is none of the learner's.
    """

    def __init__(
        self,
        model: Body,
        held: Held,
        nearest: bool = False,
        *,
        tolerance: float = TOLERANCE,
        corrected: bool | None = None,
    ) -> None:
        require_positive("tolerance", tolerance)
        together = CommandLoads(model.geometry.loaded_body)
        components, displacements = [], []
        for text in _texts(held, model.geometry.dimension):
            before = together.moved.copy()
            together.move(text, nearest)
            components.append(together.moved & ~before)
            moved = np.where(components[-1], together.displacement, 0.0)
            displacements.append(moved[np.abs(moved).argmax(axis=0), np.arange(moved.shape[1])])
        self.components = read_only(np.array(components))
        self.displacements = read_only(np.array(displacements))
        self.notes = tuple(together.notes)
        self._model, self._held = model, at_points(model.geometry, together.moved)
        self._dofs = np.flatnonzero(self._held)
        self.tolerance = tolerance
        self._search = ForceSearch(stiffness_at_rest(model.equilibrium, self._held))
        self._defect = DefectCorrection(model, corrected)
        self._shown: Shown | None = None
        self._is_far = False  # whether predictions miss the last frame
        self._field: Array = np.zeros(together.moved.shape)

    @checked_arguments
    def move(
        self,
        displacements: ArrayLike,
        load: Beside = None,
        *,
        predict: Predict | None = None,
    ) -> GripFrame:
        """Move the places to displacements from rest, and predict the body.

        Parameters
        ----------
        displacements : array, (n_places, d)
            In m; those of free components have no meaning.
        load : array (n_nodes or n_points, d), str, sequence of str or CommandLoads, optional
            A load beside the forces of the grips, as that of `Surrogate.solve`: dead forces in N,
            or texts, also of pressures.
        predict : callable, optional
            The whole dead load in N to displacements in m, (n_nodes, d), with the pressures that
            act beside it; predictions of the surrogate by default.

        Raises
        ------
        InputError
            If a shape is wrong or a number is not finite.
        WorkError
            If no forces are found, or what they predict is wrong and there is no equilibrium.
        """
        wanted, loaded = self._given(displacements, load)
        if predict is None and self._is_far:
            return self._beyond_predictions(wanted, loaded)
        shows, shown, count = predict or loaded.predict, self._shown, 0
        target = wanted.ravel()[self._dofs]
        if predict is not None or shown is None:
            self._defect.forget()
        self._defect.body = loaded

        def displaced(forces: Array) -> Array:
            nonlocal shown, count
            if shown is None or not shown.is_of(forces, loaded, predict):
                count += 1
                field = self._defect.predicted(shows, self._total(loaded, forces))
                shown = Shown(field, forces.copy(), loaded, predict)
            return self._at_held(shown)

        try:
            if predict is None and self._defect.wanted:
                self._search.find(displaced, target, max(self.tolerance, ROUGHLY))
                assert shown is not None
                felt = partial(self._felt, grips=shown.grips)
                change = self._defect.improve(shown.field, self._total(loaded, shown.grips), felt)
                shown = replace(shown, field=shown.field + change)
            self._search.find(displaced, target, self.tolerance)  # asks for what it finds last
        except WorkError as error:
            try:
                return self._corrected(wanted, loaded)
            except WorkError:
                raise error from None
        assert shown is not None
        total = self._total(loaded, shown.grips)
        if predict is None and self._defect.is_far(shown.field, total):
            return self._beyond_predictions(wanted, loaded)
        self._shown, self._field = shown, shown.field
        return self._frame(shown.field, self._of_grips(shown.grips), count)

    def _beyond_predictions(self, wanted: Array, loaded: LoadedBody) -> GripFrame:
        """Find the equilibrium, and whether it can be predicted."""
        frame, self._defect.body = self._corrected(wanted, loaded), loaded
        self._is_far = self._defect.misses(frame.displacement, loaded.with_forces(frame.force))
        return frame

    @checked_arguments
    def correct(self, displacements: ArrayLike, load: Beside = None) -> GripFrame:
        """Find the equilibrium of the finite elements, beginning at the last frame.

        Raises
        ------
        InputError
            As `move`.
        WorkError
            If no stable equilibrium is found.
        """
        return self._corrected(*self._given(displacements, load))

    def _corrected(self, wanted: Array, loaded: LoadedBody) -> GripFrame:
        found, force = self._newton.find(wanted, loaded, self._field)
        self._field, self._shown = found.displacement.copy(), None
        return self._frame(found.displacement, self._of_grips(force.ravel()[self._dofs]), 0, found)

    @cached_property
    def _newton(self) -> HeldNewton:
        return HeldNewton(self._model.equilibrium, self._held)

    def _given(self, displacements: ArrayLike, load: Beside) -> tuple[Array, LoadedBody]:
        """Displacements of the held components in m, (n_points, d), and the body under a load."""
        moved = real_numbers(displacements, "displacements")
        places, _, d = self.components.shape
        if moved.shape != (places, d) or not np.isfinite(moved).all():
            raise InputError(
                f"displacements have shape {moved.shape}, expected {places} of {d} finite numbers "
                "in m, one of each place"
            )
        wanted = np.einsum("pd,pnd->nd", moved, self.components)
        at_points = self._model.equilibrium.interpolated(wanted[None])[0]
        return at_points, LoadedBody.of(self._model, load)

    def _of_grips(self, forces: Array) -> Array:
        """The load in N, (n_nodes or n_points, d), of forces on the held components, (m,)."""
        at_points = np.zeros(self._held.size)
        at_points[self._dofs] = forces
        found = self._model.equilibrium.load_of(at_points.reshape(1, *self._held.shape))[0]
        return found if self._between else found[: len(self._field)]

    def _total(self, loaded: LoadedBody, forces: Array) -> Array:
        """The whole dead load in N with forces on the held components, (m,)."""
        return loaded.with_forces(self._of_grips(forces))

    @property
    def _between(self) -> bool:
        """Whether points between the nodes are held."""
        return bool(self._dofs[-1] >= self._field.size)

    def _at_held(self, shown: Shown) -> Array:
        """Displacements of the held components in m, (m,)."""
        field = shown.field
        if self._between:
            field = shown.loaded.at_points(field, self._total(shown.loaded, shown.grips))
        return np.asarray(field.ravel()[self._dofs])

    def _felt(self, change: Array, grips: Array) -> float:
        """Forces of grips that a change of the field in m would take, over those that there are."""
        at_points = self._model.equilibrium.interpolated(change[None])
        taken = self._search.forces_of(at_points.ravel()[self._dofs])
        return float(np.linalg.norm(taken) / (np.linalg.norm(grips) or 1.0))

    def _frame(
        self,
        field: Array,
        force: Array,
        predictions: int,
        correction: Correction | None = None,
    ) -> GripFrame:
        reactions = np.einsum("nd,pnd->pd", force[: len(field)], self.components)
        return GripFrame(field.copy(), force, reactions, predictions, correction)


def at_points(geometry: Geometry, moved: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Components that grips hold at all points: those held at all nodes around, as supports do.

    From (n_nodes, d) to (n_points, d).
    """
    points = geometry.loaded_points
    if points is None:
        return moved
    return np.asarray(points.held(geometry.held | moved) & geometry.free_at_points)


def stiffness_at_rest(body: Equilibrium, held: NDArray[np.bool_]) -> Array:
    """Inverse of the block of K⁻¹ of held components, (m, m) in N/m."""
    dofs = np.flatnonzero(held)
    block = np.empty((len(dofs), len(dofs)))
    for start in range(0, len(dofs), COLUMNS):
        some = dofs[start : start + COLUMNS]
        unit = np.zeros((len(some), held.size))
        unit[np.arange(len(some)), some] = 1.0
        response = body.linear_response(unit.reshape(-1, *held.shape))
        block[start : start + len(some)] = response.reshape(len(some), -1)[:, dofs]
    return inverse(block)


def _texts(held: Held, dimension: int) -> list[str]:
    """The notation of ``--hold``; InputError if nothing is held."""
    if isinstance(held, Mapping):
        parts = {place: ["-" if v is None else str(v) for v in u] for place, u in held.items()}
        texts = [f"{place}:{','.join(values)}" for place, values in parts.items()]
    else:
        require_type("held", held, Sequence[str])
        rest = ",".join("0" * dimension)
        texts = [text if ":" in text else f"{text}:{rest}" for text in held]
    if not texts:
        raise InputError("held: no place, expected one at least")
    return texts
