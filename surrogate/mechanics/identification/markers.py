r"""Markers of a body: where they were and are seen, and whether what a fit leaves is noise.

Of n numbers with normal noise of a given σ, a right model of p parameters leaves

.. math:: \frac{1}{σ^2} \sum_m |r_m|^2 \sim χ^2_{n - p}.

A noise that was estimated from the same :math:`r_m` says nothing of their size. But noise is
without order, whereas a wrong model leaves neighbours alike:

.. math:: I = \sum_m r_m · \sum_{j \in N(m)} r_j

over the nearest neighbours of each marker (Moran 1950, *Biometrika* 37) is then larger than nearly
all values that it has with the same :math:`r_m` in another order. A relative error of the whole
field (`surrogate.mechanics.identification.least_squares`) leaves next to nothing of either.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.spatial import KDTree
from scipy.stats import chi2

from shared_schema.common.arguments import real_numbers
from shared_schema.common.errors import InputError
from shared_schema.common.files import text_lines
from shared_schema.points_in_cells import locate
from surrogate.mechanics.body.geometry import Geometry

Array = NDArray[np.float64]

OFF = 0.5  # distance of a marker from the body that is an error, over the size of the cell there
MOST = 1e6  # m


@dataclass(frozen=True)
class Markers:
    """Markers that were seen.

    Attributes
    ----------
    at_rest, seen : array, (m, d)
        Positions in m.
    """

    at_rest: Array
    seen: Array

    @classmethod
    def of(cls, at_rest: ArrayLike, seen: ArrayLike) -> Markers:
        """Take positions, (m, d) each, without the markers that are not seen (NaN).

        Raises
        ------
        InputError
            If shapes are wrong, a position at rest is not finite, or none is seen.
        """
        x, y = real_numbers(at_rest, "markers at rest"), real_numbers(seen, "markers seen")
        if x.ndim != 2 or x.shape != y.shape or x.shape[1] not in (2, 3):
            raise InputError(f"markers have shapes {x.shape} and {y.shape}, expected (m, d) twice")
        if not np.all(np.abs(x) <= MOST) or np.any(np.abs(y) > MOST):
            raise InputError(f"markers: expected finite positions, of {MOST:g} m at most")
        there = np.isfinite(y).all(axis=1)
        if not there.any():
            raise InputError("markers: none is seen, expected one at least")
        return cls(x[there], y[there])

    @property
    def moved(self) -> Array:
        """Displacements in m, (m, d)."""
        return self.seen - self.at_rest

    def interpolation(self, geometry: Geometry) -> csr_array:
        """Displacements at the markers of those at the nodes, (m, n_nodes).

        Raises
        ------
        InputError
            If a marker is of another dimension, or off the body.
        """
        if self.at_rest.shape[1] != geometry.dimension:
            d = geometry.dimension
            raise InputError(f"markers have {self.at_rest.shape[1]} coordinates, expected {d}")
        mesh = geometry.coordinates, geometry.cells, geometry.cell_type
        cells, weights, outside = locate(self.at_rest, *mesh)
        if outside.max() > OFF:
            at = ",".join(f"{value:g}" for value in self.at_rest[outside.argmax()])
            raise InputError(f"markers: the one at {at} is off the body, expected all on or in it")
        rows = np.repeat(np.arange(len(cells)), weights.shape[1])
        shape = len(cells), len(geometry.coordinates)
        entries = weights.ravel(), (rows, geometry.cells[cells].ravel())
        return csr_array(entries, shape=shape)


def read_markers(path: Path, dimension: int) -> Markers:
    """Read markers from a file of lines X,Y[,Z],x,y[,z]: at rest, and seen (empty or nan if not).

    Raises
    ------
    InputError
        That names the file, and the line that is wrong.
    """
    expected = "X,Y,x,y" if dimension == 2 else "X,Y,Z,x,y,z"
    try:
        lines = text_lines(path, "markers")
    except InputError as error:
        raise InputError(str(error), "markers") from None
    rows = []
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.startswith("#"):
            continue
        parts = [part.strip() for part in line.split(",")]
        try:
            values = [float(part or "nan") for part in parts]
        except ValueError:
            if number == 1:
                continue  # names of the columns
            values = []
        if len(values) != 2 * dimension:
            said = f"markers '{path}': line {number}: expected {expected}"
            raise InputError(said, "markers")
        rows.append(values)
    table = np.array(rows, dtype=np.float64).reshape(-1, 2 * dimension)
    try:
        return Markers.of(table[:, :dimension], table[:, dimension:])
    except InputError as error:
        raise InputError(f"markers '{path}': {error}", "markers") from None


SUSPECT = 0.01  # probability under which what is left is no noise
NEIGHBOURS = 3
ORDERS = 999
FEW = 8  # markers that tell no order


def noise_probability(x: Array, left: Array, parameters: int, sigma: float | None) -> float:
    """Probability that noise leaves as much, or what is as much in order.

    Parameters
    ----------
    x, left : array, (m, d)
        Markers at rest that count, and what a fit leaves of their displacements, in m.
    parameters : int
        Number p of parameters.
    sigma : float or None
        Given noise of a component in m.
    """
    order = 1.0 if len(x) < FEW else order_probability(x, left)
    if sigma is None:
        return order
    size = float(chi2.sf((left**2).sum() / sigma**2, left.size - parameters))
    return min(2 * min(size, order), 1.0)  # of two tests (Bonferroni)


def order_probability(x: Array, left: Array) -> float:
    """Part of random orders, and the present one, that have neighbours as much alike."""
    _, near = KDTree(x).query(x, NEIGHBOURS + 1)
    rng = np.random.default_rng(0)
    orders = np.array([np.arange(len(x)), *(rng.permutation(len(x)) for _ in range(ORDERS))])
    ordered = left[orders]  # (orders, m, d)
    alike = np.einsum("omd,omkd->o", ordered, ordered[:, near[:, 1:]])
    return float((alike >= alike[0] * (1 - 1e-12)).mean())
