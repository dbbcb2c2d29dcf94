"""Loads that mislead estimates of an error: axial, near buckling, snapping through, far too large.

Each kind is drawn on the surface of any body, about the size of the loads of its case.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surrogate.learning.inference import Surrogate, drawn_loads
from surrogate.mechanics import Equilibrium

Array = NDArray[np.float64]
Nodes = NDArray[np.intp]
TIMES = {"usual": 1.0, "times 3": 3.0, "times 10": 10.0}
KINDS = (*TIMES, "axial", "edge", "buckling", "near buckling", "single", "snap-through")
DRAWN = 20  # usual loads whose mean size is that of the others
LEAST, GROWTH, PRECISE = 1e-3, 4.0, 1.02  # of a cell: first displacement; factors on it


class SuspectLoads:
    """Loads on one body.

    Parameters
    ----------
    model : Surrogate
    """

    def __init__(self, model: Surrogate) -> None:
        geometry = model.geometry
        self._model, self._body, self._x = model, model.body.equilibrium, geometry.coordinates
        self._known: dict[bytes, float] = {}
        usual = drawn_loads(model, DRAWN, np.random.default_rng(0))
        self._size = float(np.linalg.norm(usual, axis=2).sum(axis=1).mean())
        held = geometry.held.any(axis=1)
        self._places = np.setdiff1d(geometry.surface_nodes, np.flatnonzero(held))
        away = self._x[self._places] - self._x[held].mean(axis=0)
        axis = away[np.linalg.norm(away, axis=1).argmax()]
        self._axis = axis / np.linalg.norm(axis)

    def draw(self, kind: str, rng: np.random.Generator) -> Array:
        """Draw a load of one of `KINDS`: (n_nodes, d) in N."""
        if kind in TIMES:
            return np.asarray(TIMES[kind] * drawn_loads(self._model, 1, rng)[0])
        f, size = np.zeros_like(self._x), self._size * 10 ** rng.uniform(-1.5, 1.5)
        if kind == "axial":
            some = self._end()
            f[some] = -self._axis * rng.choice([1, 1, 1, -1]) * size / len(some)
        elif kind == "edge":
            some = self._edge(rng)
            f[some] = self._direction(rng) * size / len(some)
        elif kind == "single":
            f[rng.choice(self._places)] = self._direction(rng) * size
        elif kind == "snap-through":
            some = self._patch(rng)
            outward = self._x[some].mean(axis=0) - self._x.mean(axis=0)
            outward /= max(float(np.linalg.norm(outward)), 1e-9)
            towards = 0.2 * rng.normal(size=f.shape[1]) - outward
            f[some] = towards / np.linalg.norm(towards) * size / len(some)
        else:
            some = self._end() if rng.random() < 0.5 else self._edge(rng)
            f[some] = -self._axis if rng.random() < 0.5 else self._direction(rng)
            low, high = (0.9, 1.1) if kind == "near buckling" else (0.2, 3.0)
            f *= self._critical(f) * rng.uniform(low, high)
            if rng.random() < 0.6:  # not quite along it
                aside = np.linalg.norm(f) * 10 ** rng.uniform(-4, -1)
                f[rng.choice(self._places)] += self._direction(rng) * aside
        return f

    def _critical(self, force: Array) -> float:
        key = force.tobytes()
        if key not in self._known:
            self._known[key] = critical_factor(self._body, force)
        return self._known[key]

    def _direction(self, rng: np.random.Generator) -> Array:
        d = self._x.shape[1]
        if rng.random() < 0.6:
            return np.asarray(np.eye(d)[rng.integers(d)] * rng.choice([-1, 1]))
        drawn = rng.normal(size=d)
        return np.asarray(drawn / np.linalg.norm(drawn))

    def _end(self) -> Nodes:
        """Nodes of the end that is farthest from the supports."""
        along = self._x[self._places] @ self._axis
        return self._places[along > along.max() - 0.02 * np.ptp(along)]

    def _edge(self, rng: np.random.Generator) -> Nodes:
        """Nodes of one side of the body, or some of them."""
        values = self._x[self._places, rng.integers(self._x.shape[1])]
        at = values.max() if rng.random() < 0.7 else values.min()
        found = self._places[np.abs(values - at) < 1e-6 + 0.01 * np.ptp(values)]
        if len(found) > 2 and rng.random() < 0.3:
            return rng.choice(found, rng.integers(1, len(found)), replace=False)
        return found

    def _patch(self, rng: np.random.Generator) -> Nodes:
        """Nodes about a place."""
        distance = np.linalg.norm(self._x[self._places] - self._x[rng.choice(self._places)], axis=1)
        return self._places[distance <= max(float(np.quantile(distance, 0.03)), 1e-9)]


def critical_factor(body: Equilibrium, force: Array) -> float:
    """Factor s on a load f in N, (n_nodes, d), where K(s K(0)⁻¹ f) stops being definite, to 2 %.

    That is the one of buckling, if the body is nearly straight there. Where K stays definite, it is
    that of a displacement as long as the body.
    """
    u = body.linear_response(body.forces_at_points(force[None]))[0]
    unit = 1 / float(np.linalg.norm(u, axis=1).max())
    low = LEAST * body.cell_size * unit
    last = float(np.ptp(body.geometry.coordinates, axis=0).max()) * unit
    while low < last and is_stable(body, GROWTH * low * u):
        low *= GROWTH
    high = GROWTH * low
    while low < last and high > PRECISE * low:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if is_stable(body, middle * u) else (low, middle)
    return low


def is_stable(body: Equilibrium, u: Array) -> bool:
    """Whether no cell is inverted and K(u) is positive definite, u (n_points, d) in m."""
    if body.inverted(u[None])[0]:
        return False
    (tangent,) = body.layout.assembled(body.solid.compiled.cell_tangents(u[None]))
    return body.layout.factor(tangent) is not None
