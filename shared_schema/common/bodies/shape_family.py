r"""A family of shapes of one body: one mesh, whose nodes move with some parameters.

The positions of the nodes are quadratic polynomials of n parameters p, scaled to −1 … 1 in their
ranges [a, b]:

.. math:: x(p) = X_0 + \sum_i t_i X_i + \sum_{i ≤ j} t_i t_j X_{ij}, \qquad
          t_i = \frac{2 p_i - a_i - b_i}{b_i - a_i}

All shapes have the cells, groups and supports of the reference :math:`X_0`, in the middle of all
ranges. The polynomial passes through the shapes at `design` (a full quadratic is given by as many
as it has terms), so that a place or a radius of a round hole, on which the surface depends
linearly, is exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations_with_replacement, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.arguments import hold_read_only, real_numbers
from shared_schema.common.bodies.cells import cell_names, scaled_jacobians
from shared_schema.common.errors import InputError

Array = NDArray[np.float64]
STREAM = 2  # keeps the random numbers of shapes apart from those of loads and splits
LEAST_QUALITY = 0.2  # of a scaled Jacobian, over that of the same corner in the reference
ROUNDING = 1e-14  # of the terms, relative to the largest
MOST = 6  # parameters; their ranges have 64 corners
TERMS, NAMES, RANGES = "mesh/shape_terms", "mesh/parameter_names", "mesh/parameter_ranges"


@dataclass(frozen=True)
class ShapeFamily:
    """Node positions as a function of parameters. The arrays are read-only.

    Attributes
    ----------
    names : tuple of str
        Of the n parameters.
    ranges : array, (n, 2)
        Lowest and highest value of each.
    terms : array, (n_terms, n_nodes, d)
        :math:`X_0`, then :math:`X_i`, then :math:`X_{ij}` with i ≤ j, in m.
    """

    names: tuple[str, ...]
    ranges: Array
    terms: Array

    def __post_init__(self) -> None:
        hold_read_only(self)

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> ShapeFamily | None:
        """Take the family of a shard from its arrays; None if the body has one shape."""
        if TERMS not in arrays:
            return None
        return cls(tuple(str(name) for name in arrays[NAMES]), arrays[RANGES], arrays[TERMS])

    @classmethod
    def through(cls, ranges: Mapping[str, tuple[float, float]], positions: Array) -> ShapeFamily:
        """Lay the polynomial through shapes: (n_terms, n_nodes, d) in m, in the order of `design`.

        The first is the reference.
        """
        count = len(ranges)
        values = monomials(design(count))
        terms = np.empty_like(positions)
        terms[:] = np.linalg.solve(values, positions.reshape(len(positions), -1)).reshape(
            positions.shape
        )
        terms[np.abs(terms) < ROUNDING * np.abs(terms).max()] = 0.0
        terms[0] = positions[0]
        return cls(tuple(ranges), np.array(list(ranges.values())).reshape(count, 2), terms)

    def arrays(self) -> dict[str, Any]:
        """Arrays of a shard, by their paths."""
        names = np.array(self.names, dtype=object)
        return {NAMES: names, RANGES: self.ranges, TERMS: self.terms}

    @property
    def middle(self) -> Array:
        """Parameters of the reference, (n,)."""
        return np.asarray(self.ranges.mean(axis=1))

    def scaled(self, values: Array) -> Array:
        """Parameters t between −1 and 1 in their ranges: (..., n) → same."""
        low, high = self.ranges.T
        return np.asarray((2 * values - low - high) / (high - low))

    def coordinates(self, values: Array) -> Array:
        """Node positions in m of a shape, (n_nodes, d), from its parameters, (n,)."""
        weights = monomials(self.scaled(values)[None])[0]
        return np.asarray(np.tensordot(weights, self.terms, axes=1))

    def drawn(self, seed: int, number: int) -> Array:
        """Parameters of a sample, (n,): uniform in their ranges."""
        low, high = self.ranges.T
        return np.random.default_rng([seed, number, STREAM]).uniform(low, high)

    def checked(
        self, given: Mapping[str, float], cells: NDArray[np.int64], cell_type: str
    ) -> Array:
        """Parameters by their names, (n,), those that are not given in the middle of their ranges.

        Raises
        ------
        InputError
            If there is no such parameter, a value is no finite number, or they tangle the mesh.
        """
        found = self.middle
        for name, value in given.items():
            said = f"parameter {name}={value!s:.40}"
            if name not in self.names:
                known = ", ".join(self.names)
                raise InputError(f"{said}: no such parameter, expected {known}", "parameter")
            number = real_numbers(value, said)
            if number.shape != () or not np.isfinite(number):
                raise InputError(f"{said}: expected a finite number", "parameter")
            found[self.names.index(name)] = number
        problem = self.problem(found, cells, cell_type)
        if problem is not None:
            raise InputError(f"parameter {self.said(found)}: {problem}", "parameter")
        return found

    def outside(self, values: Array) -> list[str]:
        """Say which parameters are outside of their ranges."""
        return [
            f"parameter {name} = {value:g}, outside of its range, {low:g} to {high:g}"
            for name, value, (low, high) in zip(self.names, values, self.ranges, strict=True)
            if not low <= value <= high
        ]

    def said(self, values: Array, names: tuple[str, ...] = ()) -> str:
        """Write parameters, all or some, such as "radius = 0.3, x = 2"."""
        pairs = zip(self.names, values, strict=True)
        return ", ".join(f"{n} = {v:g}" for n, v in pairs if not names or n in names)

    def problem(self, values: Array, cells: NDArray[np.int64], cell_type: str) -> str | None:
        """Say which cells of a shape are tangled or bad; None if all are good."""
        x = self.coordinates(values)
        reference = scaled_jacobians(self.terms[0], cells, cell_type)
        with np.errstate(divide="ignore", invalid="ignore"):
            quality = scaled_jacobians(x, cells, cell_type) / reference
        worst = quality.min(axis=1)
        bad = np.flatnonzero(~(worst > LEAST_QUALITY))
        if not bad.size:
            return None
        at = ",".join(f"{value:g}" for value in x[cells[bad[worst[bad].argmin()]]].mean(axis=0))
        what = "turned over" if worst.min() <= 0 else "nearly flat"
        return f"{cell_names(bad)} {what}, the worst at {at}"

    def tangled(self, cells: NDArray[np.int64], cell_type: str) -> str | None:
        """Say which ends or corners of the ranges tangle the mesh; None if none do."""
        count = len(self.names)
        ends = [sign * row for row in np.eye(count) for sign in (-1, 1)]
        corners = [np.array(signs) for signs in product((-1, 1), repeat=count)]
        low, high = self.ranges.T
        for t in (*ends, *(corners if count > 1 else ())):
            values = (low + high + t * (high - low)) / 2
            found = self.problem(values, cells, cell_type)
            if found is not None:
                moved = tuple(name for name, far in zip(self.names, t, strict=True) if far)
                return f"{self.said(values, moved)}: {found}, expected narrower ranges"
        return None


def design(count: int) -> Array:
    """Scaled parameters of the shapes that give the polynomial, (n_terms, count).

    The middle, both ends of every range, and for each pair of parameters both upper ends.
    """
    unit = np.eye(count)
    pairs = [unit[i] + unit[j] for i, j in _pairs(count) if i != j]
    points = [np.zeros(count), *unit, *-unit, *pairs]
    return np.array(points).reshape(-1, count)


def monomials(t: Array) -> Array:
    """Factors of the terms: (N, n) → (N, n_terms)."""
    products = [t[:, i] * t[:, j] for i, j in _pairs(t.shape[1])]
    return np.column_stack([np.ones(len(t)), t, *products])


def _pairs(count: int) -> list[tuple[int, int]]:
    return list(combinations_with_replacement(range(count), 2))
