r"""One unit cell: a square with holes, its macroscopic stretch, and what the benchmark scores.

The outer edge moves with the homogeneous displacement :math:`h = (U - I)(X - X_0)`,
:math:`U = \sqrt C`, about the middle of the square. Fields are those of PLAID's 2D_MultiScHypEl
(F. Casenave et al., *PLAID: a unified data model for machine learning on heterogeneous physics
simulations*, arXiv 2505.02974): displacement, first Piola-Kirchhoff stress and strain energy
density at the nodes, and the strain energy over the area of the square.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shared_schema.common import InputError

Array = NDArray[np.float64]
FIELDS = ("u1", "u2", "P11", "P12", "P22", "P21", "psi")
STRETCH = ("C11", "C12", "C22")
ENERGY = "effective_energy"
EDGE = 1e-6  # of the side: distance of the nodes that count as those of the outer edge


class Prediction(NamedTuple):
    """Fields at the nodes, (n_nodes, 7) in the order of `FIELDS`, and the effective energy."""

    fields: Array
    energy: float


@dataclass(frozen=True)
class UnitCell:
    """A unit cell and its solution.

    Attributes
    ----------
    coordinates : array, (n_nodes, 2)
    triangles : array of int, (n_triangles, 3)
    stretch : array, (3,)
        Components C₁₁, C₁₂, C₂₂ of the macroscopic right Cauchy-Green tensor.
    solution : Prediction
    """

    coordinates: Array
    triangles: NDArray[np.int64]
    stretch: Array
    solution: Prediction

    @cached_property
    def stretch_tensor(self) -> Array:
        """U = √C, (2, 2)."""
        c11, c12, c22 = self.stretch
        values, vectors = np.linalg.eigh(np.array([[c11, c12], [c12, c22]]))
        return np.asarray(vectors * np.sqrt(values) @ vectors.T)

    @property
    def lower(self) -> Array:
        """Lower left corner of the square, (2,)."""
        return np.asarray(self.coordinates.min(axis=0))

    @property
    def sides(self) -> Array:
        """Lengths of the sides of the square, (2,)."""
        return np.ptp(self.coordinates, axis=0)

    @cached_property
    def homogeneous(self) -> Array:
        """Displacement h at the nodes, (n_nodes, 2)."""
        middle = self.lower + self.sides / 2
        return (self.coordinates - middle) @ (self.stretch_tensor - np.eye(2)).T

    @cached_property
    def is_outer(self) -> NDArray[np.bool_]:
        """True for nodes of the outer edge, (n_nodes,)."""
        place = (self.coordinates - self.lower) / self.sides
        return np.asarray(((place < EDGE) | (place > 1 - EDGE)).any(axis=1))

    @cached_property
    def areas(self) -> Array:
        """Areas of the triangles, (n_triangles,)."""
        corners = self.coordinates[self.triangles]
        first, second = (corners[:, k] - corners[:, 0] for k in (1, 2))
        return np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2

    def at_nodes(self, values: Array) -> Array:
        """Means over the triangles around every node by area: (n_triangles, k) → (n_nodes, k)."""
        sums = np.zeros((len(self.coordinates), values.shape[1] + 1))
        weighted = np.column_stack([values, np.ones(len(values))]) * self.areas[:, None]
        np.add.at(sums, self.triangles, weighted[:, None])
        return sums[:, :-1] / sums[:, -1:]

    def mean(self, values: Array) -> float:
        """Integral of values at the nodes, (n_nodes,), over the area of the square."""
        shares = np.zeros(len(self.coordinates))
        np.add.at(shares, self.triangles, self.areas[:, None] / 3)
        return float(shares @ values / self.sides.prod())


def write_cell(path: Path, cell: UnitCell) -> None:
    """Write a cell to an ``.npz`` file."""
    np.savez(
        path,
        coordinates=cell.coordinates,
        triangles=cell.triangles,
        stretch=cell.stretch,
        fields=cell.solution.fields,
        energy=np.array(cell.solution.energy),
    )


def read_cells(folder: Path) -> list[UnitCell]:
    """Read all cells of a folder, in the order of their names.

    Raises
    ------
    InputError
        If there are fewer than two.
    """
    paths = sorted(folder.glob("*.npz"))
    if len(paths) < 2:
        raise InputError(f"--folder '{folder}': {len(paths)} cells (.npz) in it, expected some")
    cells = []
    for path in paths:
        with np.load(path) as file:
            solution = Prediction(file["fields"], float(file["energy"]))
            arrays = file["coordinates"], file["triangles"], file["stretch"]
            cells.append(UnitCell(*arrays, solution))
    return cells


def scores(cells: Sequence[UnitCell], predictions: Sequence[Prediction]) -> Mapping[str, float]:
    r"""Relative errors of every field and of the energy, and ``total``, their mean.

    .. math:: e_f = \left[\frac{1}{n} \sum_i \frac{‖f_i - \hat f_i‖_2^2}
              {N_i ‖f_i‖_∞^2}\right]^{1/2}, \qquad
              e_s = \left[\frac{1}{n} \sum_i \frac{(s_i - \hat s_i)^2}{s_i^2}\right]^{1/2}

    over n cells of Nᵢ nodes each: those of PLAID's benchmarks.
    """
    squares = np.empty((len(cells), len(FIELDS) + 1))
    for row, cell, found in zip(squares, cells, predictions, strict=True):
        true = cell.solution
        largest = np.abs(true.fields).max(axis=0)
        row[:-1] = (np.square(found.fields - true.fields) / largest**2).mean(axis=0)
        row[-1] = ((found.energy - true.energy) / true.energy) ** 2
    errors = np.sqrt(squares.mean(axis=0))
    names = (*FIELDS, ENERGY)
    return dict(zip(names, errors.tolist(), strict=True)) | {"total": float(errors.mean())}


def median_score(cells: Sequence[UnitCell], predictions: Sequence[Prediction]) -> float:
    """Median of the totals of single cells."""
    pairs = zip(cells, predictions, strict=True)
    return float(np.median([scores([cell], [found])["total"] for cell, found in pairs]))
