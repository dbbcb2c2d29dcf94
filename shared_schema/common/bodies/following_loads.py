r"""Loads that follow the deformed body, of one amplitude each: pressures on surfaces, cables.

The forces on the points of the elements are

.. math:: f = a \, g(x)

with the amplitude a, a pressure in Pa or a tension in N, and the *unit forces* g of the positions
x. They work on a *quantity* q(x): where :math:`g = ± ∂q/∂x`, the load has the potential
:math:`∓ a \, q`.

=========  ====================  ============================  ====
load       amplitude a           quantity q                    sign
=========  ====================  ============================  ====
pressure   p in Pa               volume V in m³ of a cavity    \+
cable      T in N                length ℓ in m                 −
=========  ====================  ============================  ====

The volume of a cavity, whose surface Γ is closed and whose normal n points out of the body, is

.. math:: V = -\frac 1d \int_Γ x · n \, dS = \frac 1d \sum_a x_a · g_a

(Gauss's theorem); that of the fluid outside of a body would be negative. Forces and volume have
exact quadrature, so that :math:`g = ∂V/∂x` holds to rounding
(`shared_schema.common.bodies.distributed_loads`).

Along positions :math:`x(s) = \sum_k s^k x_k`, the terms of a pressure are

.. math:: g_{a,k} = -\sum_q w_q N_a \sum_{i+j=k} t_1(x_i) × t_2(x_j), \qquad
   V_k = \frac 1d \sum_{i+j=k} x_i · g_j.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.cells import edges_of
from shared_schema.common.bodies.distributed_loads import (
    facet_derivatives,
    facet_tangents,
    normals_of,
    pressure_forces,
)

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
Blocks = Iterator[tuple[Numbers, Array]]  # points (n, k), and −∂g/∂x of them (n, k · d, k · d)


class FollowingLoad(Protocol):
    """Unit forces of a load on all points of a body, with their derivatives.

    Attributes
    ----------
    sign : float
        That of :math:`g = ± ∂q/∂x`.
    """

    @property
    def sign(self) -> float:
        """That of g = ± ∂q/∂x."""

    @property
    def joins(self) -> Sequence[Numbers]:
        """Points of different cells that ∂g/∂x ties to each other, (n, k) each."""

    def quantity(self, x: Array) -> float:
        """What the amplitude works on, q(x), of positions (n_points, d) in m."""

    def forces(self, x: Array) -> Array:
        """Unit forces g(x): (n_points, d), in N over the unit of the amplitude."""

    def tangents(self, x: Array) -> Blocks:
        """Yield −∂g/∂x: numbers of points, (n, k), and blocks, (n, k · d, k · d)."""

    def terms(self, x: Sequence[Array]) -> tuple[list[Array], list[float]]:
        """Coefficients of g and q, of as many orders as those of the positions that are given."""


@dataclass(frozen=True)
class PressedSurface:
    """A unit pressure on facets of a body; it pushes into the body.

    Attributes
    ----------
    facets : array of int, (n_facets, n_points of a facet)
        Numbers of points, seen from outside of the body.
    """

    facets: Numbers
    sign = 1.0
    joins = ()

    def quantity(self, x: Array) -> float:
        """Volume of the cavity in m³, if the facets are all that bound it."""
        of_facets = x[self.facets]
        tangents, weighted, _ = facet_tangents(of_facets)
        at = np.einsum("qa,fad->fqd", weighted, of_facets)
        return -float(np.einsum("fqd,fqd->", at, normals_of(tangents))) / x.shape[1]

    def forces(self, x: Array) -> Array:
        """Unit forces g(x): (n_points, d) in m²."""
        return pressure_forces(x, self.facets, 1.0)

    def tangents(self, x: Array) -> Blocks:
        """Yield −∂g/∂x of all facets, in m."""
        yield self.facets, -facet_derivatives(x, self.facets, 1.0)

    def terms(self, x: Sequence[Array]) -> tuple[list[Array], list[float]]:
        """Coefficients of g and V along a path."""
        tangents, d = [facet_tangents(each[self.facets])[0] for each in x], x[0].shape[1]
        _, weighted, _ = facet_tangents(x[0][self.facets])
        forces, volumes = [], []
        for k in range(len(x)):
            pairs = [(i, k - i) for i in range(k + 1)] if d == 3 else [(0, k)]
            normals = sum(normals_of(_mixed(tangents[i], tangents[j])) for i, j in pairs)
            term = np.zeros_like(x[0])
            np.add.at(term, self.facets, -np.einsum("qa,fqd->fad", weighted, normals))
            forces.append(term)
            volumes.append(sum(float((x[i] * forces[k - i]).sum()) for i in range(k + 1)) / d)
        return forces, volumes


def _mixed(first: Array, second: Array) -> Array:
    """The first tangents of some facets with the last ones of others, (…, d - 1, d)."""
    return np.concatenate([first[:, :, : first.shape[2] - 1], second[:, :, -1:]], axis=2)


def is_closed(facets: Numbers) -> bool:
    """True if facets, (n, n_corners) seen from one side, leave no edge or end open."""
    if not len(facets):
        return False
    if facets.shape[1] == 2:  # every point begins one line and ends another
        return bool(np.array_equal(np.sort(facets[:, 0]), np.sort(facets[:, 1])))
    edges = edges_of(facets)
    return bool(np.array_equal(np.unique(edges, axis=0), np.unique(edges[:, ::-1], axis=0)))
