r"""What forces at some components of a body do there, as far as predictions have told.

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

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium

Array = NDArray[np.float64]
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
