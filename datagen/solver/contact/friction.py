r"""Coulomb friction of the nodes that a rigid tool touches.

In the frame of the tool a node has slipped by :math:`w = P (y - y_0)` since the last equilibrium,
with its positions y there and now, and :math:`P = I - n n^T`. It bears a force f in the tangent
plane, at most μ times the size N of its normal force, which opposes the slip:

.. math:: |f| \le μ N, \qquad w = -α f, \quad α \ge 0, \quad α \, (|f| - μ N) = 0.

At an iterate of Newton's method, with the multiplier τ, :math:`q = P τ - c \, w` and the estimate
:math:`\bar N = λ - c \, g` of the contact,

.. math::
    f = P τ - k \, w \quad \text{(stick)} \quad \text{if } |q| \le μ \bar N, \qquad
    f = μ N \, t - σ A \, w \quad \text{(slip)} \quad \text{else},

with :math:`N = λ - k \, g`, :math:`t = q / |q|` and :math:`A = P - t t^T`. The force at the next
iterate, linearised, becomes τ. In slip it is that of the linearised law
:math:`τ = μ N \, (τ - c w) / |τ - c w|`, from which :math:`σ = μ \bar N c / (|q| - μ \bar N)`
follows, at most k (Alart and Curnier 1991, *Comput. Methods Appl. Mech. Engrg.* 92). Neither c nor
k changes the equilibrium, in which w = 0 where nodes stick, and A w = 0 where they slip.

The law is one of rates: slips are those from one load step to the next, by the backward Euler
method, so that the equilibrium depends on the tool's way and, to first order, on the load steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Touching(NamedTuple):
    """What the contact says of the nodes of a surface at an iterate.

    Attributes
    ----------
    positions : array, (n, d)
        In the frame of the tool in m.
    normal : array, (n, d)
        n.
    sizes : array, (n,)
        N in N; 0 where a node bears no force.
    estimates : array, (n,)
        Estimates of N in N, positive where a node bears a force.
    """

    positions: Array
    normal: Array
    sizes: Array
    estimates: Array


class _Trial(NamedTuple):
    """w, P τ and t, (n, d); A, (n, d, d); whether nodes slip, and σ, (n,)."""

    slip: Array
    tau: Array
    along: Array
    across: Array
    slides: NDArray[np.bool_]
    turning: Array


class Friction:
    """Friction of the nodes of a surface.

    Parameters
    ----------
    coefficient : float
        μ.
    stick, complement : array, (n,)
        k and c in N/m.
    positions : array, (n, d)
        In the frame of the tool in m, at rest.

    Attributes
    ----------
    multipliers : array, (n, d)
        τ in N.
    """

    def __init__(
        self, coefficient: float, stick: Array, complement: Array, positions: Array
    ) -> None:
        self.coefficient, self._k, self._c = coefficient, stick, complement
        self._settled = positions.copy()
        self.multipliers = np.zeros_like(positions)

    def forces(self, at: Touching) -> Array:
        """Forces in N, (n, d)."""
        trial = self._trial(at)
        across = np.einsum("nij,nj->ni", trial.across, trial.slip)
        sliding = self.coefficient * at.sizes[:, None] * trial.along
        sliding = sliding - trial.turning[:, None] * across
        sticking = trial.tau - self._k[:, None] * trial.slip
        found = np.where(trial.slides[:, None], sliding, sticking)
        return np.where(at.sizes[:, None] != 0, found, 0.0)

    def tangents(self, at: Touching, normal_stiffness: Array) -> Array:
        """Derivative of −`forces` by the positions, (n, d, d); that of N is −k n of the contact."""
        trial, n = self._trial(at), at.normal
        growing = (self.coefficient * normal_stiffness)[:, None, None]
        sliding = growing * trial.along[:, :, None] * n[:, None, :]
        sliding = sliding + trial.turning[:, None, None] * trial.across
        sticking = self._k[:, None, None] * _planes(n)
        found = np.where(trial.slides[:, None, None], sliding, sticking)
        return np.where((at.sizes != 0)[:, None, None], found, 0.0)

    def settle(self, positions: Array, forces: Array) -> None:
        """Take an equilibrium as the one from which slips count."""
        self._settled, self.multipliers = positions.copy(), forces.copy()

    def _trial(self, at: Touching) -> _Trial:
        planes = _planes(at.normal)
        slip = np.einsum("nij,nj->ni", planes, at.positions - self._settled)
        tau = np.einsum("nij,nj->ni", planes, self.multipliers)
        q, limit = tau - self._c[:, None] * slip, self.coefficient * at.estimates
        length = np.linalg.norm(q, axis=1)
        along = q / np.where(length > 0, length, 1.0)[:, None]
        slides = length > limit
        beyond = np.where(slides, length - limit, 1.0)
        turning = np.minimum(limit * self._c / beyond, self._k)
        across = planes - along[:, :, None] * along[:, None, :]
        return _Trial(slip, tau, along, across, slides, turning)


def _planes(normal: Array) -> Array:
    """P, (n, d, d)."""
    return np.asarray(np.eye(normal.shape[1]) - normal[:, :, None] * normal[:, None, :])
