r"""A body that can be held and pushed, under a load beside that, and what forces do there.

As far as predictions have told, forces at some components S do

.. math:: δu = C \, δf, \qquad C = (K^{-1})_{SS} + \sum_i ± v_i v_i^T

with the columns of :math:`K^{-1}` of the components that have borne forces, and updates by which C
does to the changes of the forces what predictions have done (Nocedal and Wright 2006, *Numerical
Optimization*, chapter 6): with a change s of the forces and y of the displacements, and the lack
:math:`r = y - C s`,

.. math:: C ← C + \frac{r r^T}{r^T s} \quad (r^T s > 0), \qquad
          C ← C + \frac{y y^T}{y^T s} - \frac{C s \, s^T C}{s^T C s} \quad \text{else}.

Both keep C symmetric and positive definite.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.command_loads import CommandLoads
from surrogate.mechanics.descent.aim import Aim
from surrogate.mechanics.descent.driven_body import DrivenBody
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.statics.load import GivenLoad, Load
from surrogate.mechanics.statics.prediction import Predictor

Array = NDArray[np.float64]
Beside: TypeAlias = "GivenLoad | CommandLoads | Load | LoadedBody | None"
Predict: TypeAlias = Callable[[Array], Array]


@dataclass(frozen=True)
class LoadedBody:
    """A body under a load, beside which forces of grips or tools act.

    Attributes
    ----------
    model : Predictor
    load : Load
        Of one load case; without pressures that are all zero.
    """

    model: Predictor
    load: Load

    @classmethod
    def of(cls, model: Predictor, load: Beside = None) -> LoadedBody:
        """Read a load as `Surrogate.solve` does; InputError if it is wrong."""
        if isinstance(load, LoadedBody):
            return load
        if load is None:
            load = Load(np.zeros(model.body.geometry.coordinates.shape))
        elif not isinstance(load, Load):
            load = Load.of(model.body.geometry, load)
        presses = load.following is not None and load.following.amplitudes.any()
        return cls(model, load if presses else Load(load.dead))

    @property
    def following(self) -> FollowingLoads | None:
        """Pressures and cables of the load."""
        return self.load.following

    def is_under(self, other: LoadedBody | None) -> bool:
        """Whether the load is the same as another one."""
        if other is None or not np.array_equal(self.load.dead, other.load.dead):
            return False
        one, two = self.following, other.following
        if one is None or two is None:
            return one is two
        same = np.array_equal(one.amplitudes, two.amplitudes)
        return same and np.array_equal(one.at_rest, two.at_rest)

    def part(self, share: float) -> LoadedBody:
        """The body under a part of the load."""
        return self if share == 1.0 else replace(self, load=self.load.part(share))

    def acts(self, force: Array) -> bool:
        """Whether anything moves the body, beside pressures a dead load in N."""
        return self.following is not None or bool(force.any())

    def with_forces(self, force: Array) -> Array:
        """The dead load in N with other forces, (n_nodes or n_points, d); supports bear some."""
        few, many = sorted((self.load.dead, force), key=len)
        total = many.copy()
        total[: len(few)] += few
        geometry = self.model.body.geometry
        total[: len(geometry.coordinates)][~geometry.free] = 0.0
        return total

    def predict(self, dead: Array) -> Array:
        """Displacements in m, (n_nodes, d), under a dead load in N and the pressures."""
        return self.model.respond(replace(self.load, dead=dead))[0]

    def driven(self, tolerance: float) -> Predict:
        """Predictions that directions drive to a relative tolerance."""
        aim = Aim(tolerance)

        def predict(dead: Array) -> Array:
            load = replace(self.load, dead=dead)
            found, (last,) = self.model.respond(load)
            return self.model.body.descend(load, found, aim, float(last))[0]

        return predict

    @cached_property
    def equilibrium(self) -> Equilibrium:
        """The equilibrium of the body under the pressures."""
        return self.model.body.under(self.following)

    @cached_property
    def driven_body(self) -> DrivenBody:
        """The body under the pressures as directions see it."""
        return self.model.body.driven_body.under(self.following)

    def at_points(self, field: Array, dead: Array) -> Array:
        """Displacement of all points in m, (n_points, d), by that of the nodes, under a load."""
        f = self.equilibrium.forces_at_points(dead[None])
        return self.equilibrium.at_points(field[None], f)[0]

    def is_stable(self, u: Array) -> bool:
        """Whether an equilibrium of the body, (n_points, d) in m, is one without its condition."""
        return self.equilibrium.response_at(u) is not None


Numbers = NDArray[np.int64]

SOLVED = 64  # columns that are solved for at once
UPDATES, RECENT = 40, 8  # changes that are kept; those that are kept when there are too many
PARALLEL = 1e-6  # cosine of r and s, or y and s, below which nothing is learned


class LinearBody:
    """Linear response of some components of a body around a prediction.

    Parameters
    ----------
    body : Equilibrium
    components : array of int, (m,)
        Degrees of freedom of its points, point · d + axis.

    Attributes
    ----------
    between : bool
        Whether some are between the nodes.
    at_rest : array, (m,)
        Zeros.
    """

    def __init__(self, body: Equilibrium, components: Numbers) -> None:
        self._body, self.components = body, components
        self._nodal = body.nodes * body.free.shape[1]
        self.between = bool(components.max(initial=0) >= self._nodal)
        self.at_rest: Array = np.zeros(len(components))
        self._rows = np.full(len(components), -1)
        self._columns: Array = np.empty((0, len(components)))
        self.forget()

    def forget(self) -> None:
        """Be the body at rest."""
        self._vectors: Array = np.empty((0, len(self.components)))
        self._signs: Array = np.empty(0)
        self._changes: list[tuple[Array, Array]] = []
        self._stiffness: Array | None = None  # C⁻¹, once it is asked for

    def load(self, forces: Array) -> Array:
        """Loads in N, (N, n_nodes or n_points, d), of forces on the components, (N, m).

        They say what acts between the nodes only where a component is.
        """
        at_points = np.zeros((len(forces), self._body.free.size))
        at_points[:, self.components] = forces
        if not self.between:
            return at_points[:, : self._nodal].reshape(len(forces), self._body.nodes, -1)
        return self._body.load_of(at_points.reshape(-1, *self._body.free.shape))

    def moved(self, forces: Array) -> Array:
        """Displacements in m, (m,), under forces in N, (m,)."""
        some = np.flatnonzero(forces)
        self._solve_for(some)
        work = self._vectors[:, some] @ forces[some]
        found = (
            forces[some] @ self._columns[self._rows[some]] + (self._signs * work) @ self._vectors
        )
        return np.asarray(found)

    def compliance(self, at: Numbers, of: Numbers) -> Array:
        """Displacements in m of some components by unit forces in N on others, (a, o)."""
        self._solve_for(of)
        found = self._columns[self._rows[of][:, None], at]
        return np.asarray((found + (self._vectors[:, of].T * self._signs) @ self._vectors[:, at]).T)

    def forces_for(self, moved: Array) -> Array:
        """Forces in N, (m,), that move all components by displacements in m: :math:`C^{-1} δu`."""
        if self._stiffness is None:
            every = np.arange(len(self.components))
            self._stiffness = np.asarray(np.linalg.inv(self.compliance(every, every)), np.float64)
        return np.asarray(self._stiffness @ moved)

    def learn(self, change: Array, effect: Array) -> Array:
        """Let a change of the forces in N have its effect in m, both (m,); return the lack r."""
        expected = self.moved(change)
        lack, work = effect - expected, float(effect @ change)
        if work <= PARALLEL * np.linalg.norm(effect) * np.linalg.norm(change):
            return lack
        self._changes.append((change, effect))
        if len(self._changes) > UPDATES:
            recent = self._changes[-RECENT:]
            self.forget()
            for one in recent:
                self.learn(*one)
            return lack
        slope = float(lack @ change)
        if slope > PARALLEL * np.linalg.norm(lack) * np.linalg.norm(change):
            self._add(lack, slope, 1.0)
        elif slope < 0:
            self._add(effect, work, 1.0)
            self._add(expected, float(expected @ change), -1.0)
        return lack

    def _add(self, vector: Array, square: float, sign: float) -> None:
        vector = vector / np.sqrt(square)
        self._vectors = np.concatenate([self._vectors, vector[None]])
        self._signs = np.append(self._signs, sign)
        if self._stiffness is not None:  # by the formula of Sherman and Morrison
            lifted = self._stiffness @ vector
            part = sign / (1 + sign * float(vector @ lifted))
            self._stiffness = self._stiffness - part * np.outer(lifted, lifted)

    def _solve_for(self, some: Numbers) -> None:
        """Add what is missing of some columns of K⁻¹ to those that are kept."""
        missing = some[self._rows[some] < 0]
        for start in range(0, len(missing), SOLVED):
            part = missing[start : start + SOLVED]
            unit = np.zeros((len(part), len(self.components)))
            unit[np.arange(len(part)), part] = 1.0
            response = self._body.linear_response(self._body.forces_at_points(self.load(unit)))
            self._rows[part] = len(self._columns) + np.arange(len(part))
            columns = response.reshape(len(part), -1)[:, self.components]
            self._columns = np.concatenate([self._columns, columns])
