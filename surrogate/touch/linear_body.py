r"""What forces on the surface of a body do there, as far as predictions have told.

.. math:: δu = C \, δf, \qquad C = (K^{-1})_{SS} + \sum_i ± v_i v_i^T

with the columns of :math:`K^{-1}` of the nodes that have been touched, and updates by which C does
to the changes of the forces what predictions have done (Nocedal and Wright 2006, *Numerical
Optimization*, chapter 6): with a change s of the forces and y of the displacements, and the lack
:math:`r = y - C s`,

.. math:: C ← C + \frac{r r^T}{r^T s} \quad (r^T s > 0), \qquad
          C ← C + \frac{y y^T}{y^T s} - \frac{C s \, s^T C}{s^T C s} \quad \text{else}.

Both keep C symmetric and positive definite.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surrogate.touch.body import Body

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

SOLVED = 20  # nodes whose columns are solved for at once
UPDATES, RECENT = 40, 8  # changes that are kept; those that are kept when there are too many
PARALLEL = 1e-6  # cosine of r and s, or y and s, below which nothing is learned


class LinearBody:
    """Linear response of the surface of a body around a prediction.

    Parameters
    ----------
    model : Surrogate
    surface : array of int, (n,)
        Nodes.

    Attributes
    ----------
    size : float
        Largest extent of the undeformed surface in m.
    """

    def __init__(self, model: Body, surface: Numbers) -> None:
        self._model, self._surface = model, surface
        self.size = float(np.ptp(model.geometry.coordinates[surface], axis=0).max())
        self._dimension = model.geometry.dimension
        self._places = np.full(len(surface), -1)
        self._columns: Array = np.empty((0, self._dimension, len(surface) * self._dimension))
        self.forget()

    def forget(self) -> None:
        """Be the body at rest."""
        self._vectors: Array = np.empty((0, len(self._surface), self._dimension))
        self._signs: Array = np.empty(0)
        self._changes: list[tuple[Array, Array]] = []

    def moved(self, nodes: Numbers, forces: Array) -> Array:
        """Displacements in m of the surface, (n, d), under forces in N on some nodes, (m, d)."""
        self._solve_for(nodes)
        columns = self._columns[self._places[nodes]].reshape(forces.size, self._columns.shape[-1])
        found = forces.ravel() @ columns
        if len(self._signs):
            work = self._at(nodes) @ forces.ravel()
            found += (self._signs * work) @ self._vectors.reshape(len(work), -1)
        return np.asarray(found.reshape(len(self._surface), -1))

    def compliance(self, at: Numbers, of: Numbers) -> Array:
        """Displacements in m at some nodes by unit forces in N on others, (n d, m d)."""
        self._solve_for(of)
        d = self._dimension
        columns = self._columns.reshape(len(self._columns), d, -1, d)
        pairs = columns[self._places[of][:, None], :, at]  # (of, at, direction of, direction at)
        found = pairs.transpose(1, 3, 0, 2).reshape(len(at) * d, len(of) * d)
        return np.asarray(found + self._at(at).T @ (self._signs[:, None] * self._at(of)))

    def learn(self, change: Array, effect: Array) -> Array:
        """Let a change of the forces in N have its effect in m, both (n, d); return the lack r."""
        nodes = np.flatnonzero(change.any(axis=1))
        expected = self.moved(nodes, change[nodes])
        lack, work = effect - expected, float((effect * change).sum())
        if not len(nodes) or work <= PARALLEL * np.linalg.norm(effect) * np.linalg.norm(change):
            return lack
        self._changes.append((change, effect))
        if len(self._changes) > UPDATES:
            recent = self._changes[-RECENT:]
            self.forget()
            for one in recent:
                self.learn(*one)
            return lack
        slope = float((lack * change).sum())
        if slope > PARALLEL * np.linalg.norm(lack) * np.linalg.norm(change):
            self._add(lack, slope, 1.0)
        elif slope < 0:
            self._add(effect, work, 1.0)
            self._add(expected, float((expected * change).sum()), -1.0)
        return lack

    def _add(self, vector: Array, square: float, sign: float) -> None:
        self._vectors = np.concatenate([self._vectors, vector[None] / np.sqrt(square)])
        self._signs = np.append(self._signs, sign)

    def _at(self, nodes: Numbers) -> Array:
        some = np.take(self._vectors, nodes, axis=1)
        return np.asarray(some.reshape(len(some), len(nodes) * self._dimension))

    def _solve_for(self, nodes: Numbers) -> None:
        """Add what is missing of the columns of K⁻¹ of some nodes to those kept, (m, d, n d)."""
        missing = nodes[self._places[nodes] < 0]
        shape = self._model.geometry.coordinates.shape
        for start in range(0, len(missing), SOLVED):
            some = missing[start : start + SOLVED]
            unit = np.zeros((len(some), shape[1], *shape))
            for axis in range(shape[1]):
                unit[np.arange(len(some)), axis, self._surface[some], axis] = 1.0
            body = self._model.equilibrium
            response = body.linear_response(body.forces_at_points(unit.reshape(-1, *shape)))
            columns = response[:, : body.nodes].reshape(unit.shape)[:, :, self._surface]
            self._places[some] = len(self._columns) + np.arange(len(some))
            columns = columns.reshape(len(some), shape[1], -1)
            self._columns = np.concatenate([self._columns, columns])
