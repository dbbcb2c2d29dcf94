"""Stiffness of a plane-strain body of quadrilaterals, assembled cell by cell."""

from __future__ import annotations

import numpy as np

from shared_schema.stiffness import Stiffness
from surrogate.mechanics.body.geometry import Geometry

LAM, MU = 500 * 0.4 / (1.4 * 0.2), 500 / 2.8
CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


def plane_strain_stiffness(geometry: Geometry) -> np.ndarray:
    """Assemble bilinear quadrilaterals with 2 x 2 Gauss points; return (n_dofs, n_dofs) in N/m."""
    law = np.array([[LAM + 2 * MU, LAM, 0], [LAM, LAM + 2 * MU, 0], [0, 0, MU]])
    k = np.zeros(2 * (geometry.coordinates.size,))
    for cell in geometry.cells:
        dofs = (2 * cell[:, None] + np.arange(2)).ravel()
        for point in CORNERS / np.sqrt(3):
            slope = CORNERS * (1 + CORNERS * point)[:, ::-1] / 4
            jacobian = slope.T @ geometry.coordinates[cell]
            gradient = slope @ np.linalg.inv(jacobian).T
            strain = np.zeros((3, 8))
            strain[0, ::2], strain[1, 1::2] = gradient.T
            strain[2, ::2], strain[2, 1::2] = gradient[:, ::-1].T
            k[np.ix_(dofs, dofs)] += strain.T @ law @ strain * np.linalg.det(jacobian)
    return k


def sparse(k: np.ndarray) -> Stiffness:
    k = (k + k.T) / 2
    row, column = np.nonzero(k)
    return Stiffness(k[row, column], column, np.searchsorted(row, np.arange(len(k) + 1)))
