r"""Grips: places of a body that are held at given displacements, and the forces that hold them.

A surrogate predicts the displacement u of given nodal forces. Of a grip the displacement
:math:`\bar u` of some components H is given, and the forces g there are sought, beside a load f:

.. math:: \bar u - u_H(f + g) = 0

by predictions around which the body is linear (`surrogate.mechanics.touch.search`), frame by frame
(`surrogate.mechanics.touch.frames`).

Where Newton's method finds the body, held components are supports at given displacements. From a
state u that is known, they move by δ, and the rest of the body with them to first order,

.. math:: u + δ - K^{-1} K(u) \, δ

with the inverse of K at free components; Newton's method with a line search goes on from there
(`surrogate.mechanics.certify.correction`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shared_schema.common.arguments import (
    checked_arguments,
    read_only,
    real_numbers,
    require_type,
)
from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.common.errors import InputError, WorkError
from shared_schema.common.units import SI, Units
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.certify.correction import Correction, stable_state
from surrogate.mechanics.descent.driven_body import longest
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.statics.prediction import Predictor
from surrogate.mechanics.touch.condition import Held as HeldComponents
from surrogate.mechanics.touch.frames import Frames
from surrogate.mechanics.touch.loaded_body import Beside, LoadedBody, Predict

Array = NDArray[np.float64]
Held: TypeAlias = Mapping[str, Sequence[float | None]] | Sequence[str]

TOLERANCE = 1e-4  # of frames, of the largest held displacement
START = "last state of the grips"
SMALL = 1e-6  # of an edge of a cell: displacement whose difference is taken


def held_line(reaction: Array, units: Units) -> str:
    """Describe what holds a place, (d,) in N."""
    parts = ", ".join(f"{component:.4g}" for component in reaction)
    return f"held by ({parts}) {units.force}"


@dataclass(frozen=True, repr=False)
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
    units : Units
        Labels of the units of the case.
    """

    displacement: Array
    force: Array
    reactions: Array
    predictions: int
    correction: Correction | None = None
    units: Units = SI

    def __repr__(self) -> str:
        """Say what holds the body, and how far it moves."""
        held = "; ".join(held_line(reaction, self.units) for reaction in self.reactions)
        largest = self.units.written(longest(self.displacement))
        return f"GripFrame({held}; largest displacement {largest})"


class Grip(Frames[HeldComponents, GripFrame]):
    """Places of a body that are held, and moved frame by frame.

    >>> grip = Grip(model, ["4,1"])                        # doctest: +SKIP
    >>> frame = grip.move([(0.02, -0.1)])                  # doctest: +SKIP
    >>> frame.reactions                                    # in N  # doctest: +SKIP

    Parameters
    ----------
    model : Surrogate, or Series
    held : sequence of str, or mapping of str to displacements
        Places of nodes, such as "4,1", and named groups of the mesh, whose nodes all move by the
        same displacement; also with displacements, such as "4,1:0.02,-". A mapping from
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
        model: Predictor,
        held: Held,
        nearest: bool = False,
        *,
        tolerance: float = TOLERANCE,
        corrected: bool | None = None,
    ) -> None:
        together = CommandLoads(model.body.geometry.loaded_body)
        places, displacements = [], []
        for text in texts_of_held(held, model.body.geometry.dimension):
            before = together.moved.copy()
            together.move(text, nearest)
            places.append(together.moved & ~before)
            moved = np.where(places[-1], together.displacement, 0.0)
            displacements.append(moved[np.abs(moved).argmax(axis=0), np.arange(moved.shape[1])])
        self.components = read_only(np.array(places))
        self.displacements = read_only(np.array(displacements))
        self.notes = tuple(together.notes)
        components = np.flatnonzero(at_points(model.body.geometry, together.moved))
        super().__init__(model, components, tolerance, corrected)

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
        return self._moved(*self._given(displacements, load), predict)

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
        return self._corrected(*self._given(displacements, load))[0]

    def _given(self, displacements: ArrayLike, load: Beside) -> tuple[HeldComponents, LoadedBody]:
        """What is held where, and the body under a load."""
        moved = real_numbers(displacements, "displacements")
        places, _, d = self.components.shape
        if moved.shape != (places, d) or not np.isfinite(moved).all():
            raise InputError(
                f"displacements have shape {moved.shape}, expected {places} of {d} finite numbers "
                "in m, one of each place"
            )
        wanted = np.einsum("pd,pnd->nd", moved, self.components)
        at_points = self._model.body.equilibrium.interpolated(wanted[None])
        held = HeldComponents(at_points.ravel()[self._body.components])
        return held, LoadedBody.of(self._model, load)

    def _frame(self, predictions: int, correction: Correction | None = None) -> GripFrame:
        """Describe what is shown."""
        field, force = self._shown.field, self._body.load(self._shown.force[None])[0]
        reactions = np.einsum("nd,pnd->pd", force[: len(field)], self.components)
        units = self._model.body.geometry.units
        return GripFrame(field.copy(), force, reactions, predictions, correction, units)

    @cached_property
    def _supported(self) -> Equilibrium:
        """The body with supports where it is held."""
        body, fixed = self._model.body.equilibrium, ~self._model.body.equilibrium.free
        fixed.ravel()[self._body.components] = True
        supports = replace(body.geometry, single=fixed, clamped=np.asarray(fixed.all(axis=1)))
        materials = body.solid.materials
        return Equilibrium(supports, materials[0] if len(materials) == 1 else materials)

    def _balanced(
        self, condition: HeldComponents, loaded: LoadedBody, u: Array, force: Array
    ) -> tuple[Correction, Array]:
        """Equilibrium of the held body; the grips bear what is out of balance without them."""
        components, body = self._body.components, self._supported
        if loaded.following is not None:
            body = body.under(loaded.following)
        f, moved = loaded.equilibrium.forces_at_points(loaded.load.dead[None]), np.zeros_like(u)
        moved.ravel()[components] = condition.target - u.ravel()[components]
        found = stable_state(body, f, lifted(body, u, f, moved), START)
        out = loaded.equilibrium.out_of_balance(found.displacement[None], f)
        return found, out.ravel()[components]


def lifted(body: Equilibrium, u: Array, f: Array, moved: Array) -> Array:
    """Move held components, and the rest with them to first order: (1, n_points, d) in m."""
    largest = float(np.abs(moved).max())
    if largest == 0:
        return u
    small = SMALL * body.cell_size / largest
    change = body.out_of_balance(u + small * moved, f) - body.out_of_balance(u, f)
    response = body.response_at(u[0]) or body.linear_response
    found = u + moved - response(change / small)
    if body.inverted(found)[0]:
        raise WorkError("cells are inverted")
    return np.asarray(found)


def at_points(geometry: Geometry, moved: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Components that grips hold at all points: those held at all nodes around, as supports do.

    From (n_nodes, d) to (n_points, d).
    """
    points = geometry.loaded_points
    if points is None:
        return moved
    return np.asarray(points.held(geometry.held | moved) & geometry.free_at_points)


def texts_of_held(held: Held, dimension: int) -> list[str]:
    """Texts of places and displacements; InputError if nothing is held."""
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
