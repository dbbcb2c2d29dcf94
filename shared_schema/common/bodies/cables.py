r"""Cables through a body without friction: length, forces, stiffness and power series.

A cable is a polyline through points :math:`y_i = \sum_b W_{ib} \, x_b + c_i`: those that move with
the body have the shape functions :math:`W_{ib}` of its element there, those fixed in space a place
:math:`c_i`. With :math:`e_i = y_{i+1} - y_i` and :math:`n_i = e_i / |e_i|`, a tension T has

.. math:: ℓ = \sum_i |e_i|, \qquad f = -T \frac{∂ℓ}{∂x}, \qquad
   \frac{∂ℓ}{∂e_i} = n_i, \qquad \frac{∂^2 ℓ}{∂e_i^2} = \frac{I - n_i n_i^T}{|e_i|}.

The forces of a cable without fixed points have neither a resultant nor a moment. Along a path
:math:`x(s)`, with :math:`e = \sum_k s^k e_k` and :math:`c = e · e`,

.. math:: (|e|^{-1})_k = \frac 1{c_0} \sum_{j=1}^k \Big(\frac j{2k} - 1\Big) c_j \,
   (|e|^{-1})_{k-j}, \qquad n_k = \sum_j (|e|^{-1})_j \, e_{k-j}, \qquad
   ℓ_k = \sum_j e_j · n_{k-j}

(D. E. Knuth, *The Art of Computer Programming* 2, Section 4.7).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.bodies.following_loads import Blocks

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cable:
    """A cable of unit tension; `shared_schema.common.bodies.following_loads` says what it has.

    Attributes
    ----------
    weights : sparse array, (n_places, n_points)
        W: shape functions of the elements at the points of the cable; 0 of those fixed in space.
    fixed : array, (n_places, d)
        c in m; 0 of the points that move with the body.
    """

    weights: csr_array
    fixed: Array
    sign = -1.0

    def places(self, x: Array) -> Array:
        """Where the points of the cable are: (n_places, d) in m."""
        return np.asarray(self.weights @ x + self.fixed)

    def quantity(self, x: Array) -> float:
        """Length in m."""
        return float(np.linalg.norm(np.diff(self.places(x), axis=0), axis=1).sum())

    def forces(self, x: Array) -> Array:
        """Unit forces g(x): (n_points, d), without unit."""
        e = np.diff(self.places(x), axis=0)
        return -np.asarray(self.legs.T @ (e / np.linalg.norm(e, axis=1, keepdims=True)))

    def tangents(self, x: Array) -> Blocks:
        """Yield −∂g/∂x of one leg of the cable after the other, in 1/m."""
        e, d, legs = np.diff(self.places(x), axis=0), x.shape[1], self.legs
        shares = np.split(legs.data, legs.indptr[1:-1])
        for leg, share, points in zip(e, shares, self.joins, strict=True):
            size = np.linalg.norm(leg)
            across = (np.eye(d) - np.outer(leg, leg) / size**2) / size
            yield points, np.kron(np.outer(share, share), across)[None]

    def terms(self, x: Sequence[Array]) -> tuple[list[Array], list[float]]:
        """Coefficients of g and ℓ along a path."""
        e = [self.legs @ each for each in x]
        e[0] = e[0] + np.diff(self.fixed, axis=0)
        squares: list[Array] = []
        inverse: list[Array] = []
        units: list[Array] = []
        lengths: list[float] = []
        for k in range(len(e)):
            orders = range(k + 1)
            squares.append(np.sum([(e[j] * e[k - j]).sum(axis=1) for j in orders], axis=0))
            parts = [(j / (2 * k) - 1) * squares[j] * inverse[k - j] for j in orders[1:]]
            inverse.append(np.sum(parts, axis=0) / squares[0] if k else squares[0] ** -0.5)
            units.append(np.sum([inverse[j][:, None] * e[k - j] for j in orders], axis=0))
            lengths.append(sum(float((e[j] * units[k - j]).sum()) for j in orders))
        return [-np.asarray(self.legs.T @ n) for n in units], lengths

    @property
    def joins(self) -> list[NDArray[np.int64]]:
        """Numbers of the points of the body that each leg joins, (1, k) each."""
        indices = self.legs.indices.astype(np.int64)
        return [points[None] for points in np.split(indices, self.legs.indptr[1:-1])]

    @cached_property
    def legs(self) -> csr_array:
        """Weights of the points of the body in :math:`e_i`: (n_places − 1, n_points)."""
        return csr_array(self.weights[1:] - self.weights[:-1])
