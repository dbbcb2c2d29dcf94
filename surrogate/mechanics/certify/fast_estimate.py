r"""Errors and stability without a factorisation: a few steps of Lanczos's method.

Newton's step :math:`δ = -K(u)^{-1} r` (`surrogate.mechanics.certify.full_certificate`) factorises
the tangent of every prediction. Here the compliance of the undeformed body is carried to the
prediction,
:math:`P ≈ K(u)^{-1}` (`surrogate.mechanics.descent.carried_compliance`), and

.. math::
    x = \arg\min \tfrac{1}{2} x · K(u) \, x + r · x, \qquad
    x \in \mathrm{span} \, \{P r, \; P \, K(u) \, P r\}

so that :math:`x ≈ δ`, and the error is about :math:`-x`. In the norm of the energy, x is no larger
than δ. The forces s that are left move the body by :math:`K(u)^{-1} s`, which is about
:math:`P \, s / θ` at most in that norm, with the θ below. Under pressures that follow the surface
the energy is that of the symmetric part of K(u), and x is near the step of that part. A product
with K(u) is a difference of out-of-balance forces, of any material, element and load. Where a cell
is inverted, the error is infinite.

The same steps see whether K(u) is positive definite. Their least Ritz value

.. math:: θ = \min_y \frac{y · V^T K V \, y}{y · y}, \qquad V^T P^{-1} V = I

in their span V is an upper bound of the smallest eigenvalue of :math:`P \, K(u)`, which each step
lowers (Saad, *Iterative Methods for Sparse Linear Systems*, 2003, Section 6.7). Steps from r may
miss an instability, as that of a straight beam under an axial load, whose r has no part along its
buckling mode. So θ is also that in the span of the softest modes, in which bodies buckle
(`surrogate.mechanics.descent.soft_modes`).

Elements may have points between the nodes, at which nothing is predicted. They are moved to where
they are in equilibrium, as those of a full certificate
(`surrogate.mechanics.equilibrium.quadratic`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.descent.driven_body import DrivenBody
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads

Array = NDArray[np.float64]
STEPS = 2
CONVERGED = 1e-6  # of the work w · P w of a product: what P in single precision leaves of it


class FastEstimate:
    """Estimated errors of predictions on one body.

    Parameters
    ----------
    body : DrivenBody
        Under dead loads.
    """

    def __init__(self, body: DrivenBody) -> None:
        self.body, self.equilibrium = body, body.equilibrium
        self.loadable, self.units = self.equilibrium.geometry.loadable, self.equilibrium.units

    def __call__(
        self, forces: Array, predicted: Array, following: FollowingLoads | None = None
    ) -> Array:
        """Estimate the predicted minus the true displacement in m: (N, n_nodes, d) → same.

        Parameters
        ----------
        forces : array, (N, n_nodes or n_points, d)
            Dead loads in N (`surrogate.mechanics.equilibrium.quadratic`).
        predicted : array, (N, n_nodes, d)
            Displacements in m. What is predicted for clamped nodes is wholly an error.
        following : FollowingLoads, optional
            Pressures of the N load cases.
        """
        return self.with_stability(forces, predicted, following, judged=False)[0]

    def with_stability(
        self,
        forces: Array,
        predicted: Array,
        following: FollowingLoads | None = None,
        judged: bool = True,
    ) -> tuple[Array, Array, Array]:
        """Estimate the errors as a call does, and judge the stability of the predicted states.

        By the softest modes as well if they are to be `judged`.

        Returns
        -------
        error : array, (N, n_nodes, d)
            Estimate of the predicted minus the true displacement in m.
        rest : array, (N, n_nodes, d)
            Response P s in m to the forces that the estimate leaves out of balance; 0 where the
            error is infinite.
        softest : array, (N,)
            θ, which is 1 for the undeformed body; −∞ if a cell is inverted. If it is not positive,
            K(u) is not positive definite; its size then means nothing.
        """
        error, rest = np.full(predicted.shape, np.inf), np.zeros(predicted.shape)
        softest, nodes = np.full(len(predicted), -np.inf), predicted.shape[1]
        for row, (load, u) in enumerate(zip(forces, predicted, strict=True)):
            one = slice(row, row + 1)
            body = self.body.under(None if following is None else following[one])
            (f,), (held,) = body.equilibrium.posed(load[None], u[None])
            state = body.state(held, f)
            if state is None:
                continue
            carried = body.compliance.at(state.u)
            product = partial(body.product, state, f)
            steps = lanczos(product, carried, -state.r, STEPS)
            error[row], softest[row] = u - held[:nodes] - steps.solution[:nodes], steps.softest
            rest[row] = steps.rest[:nodes]
            if judged:
                softest[row] = min(softest[row], body.softest(state, f))
        return error, rest, softest


@dataclass(frozen=True)
class Steps:
    """What steps from a force g towards K(u)⁻¹ g found.

    Attributes
    ----------
    solution, rest : array, (n_points, d)
        The x = V y of least energy, and P (g − K x), in m.
    softest : float
        Least Ritz value θ; +∞ if g is zero, −∞ if a number is not finite.
    """

    solution: Array
    rest: Array
    softest: float


def lanczos(
    product: Callable[[Array], Array | None], carried: Callable[[Array], Array], g: Array, most: int
) -> Steps:
    """Take steps by Lanczos's method, with all directions made orthogonal to each other.

    Parameters
    ----------
    product : callable
        K(u) of a displacement, (n_points, d) in m to forces in N; None if there is none.
    carried : callable
        P.
    g : array, (n_points, d)
        In N.
    most : int
        Number of steps at most.
    """
    forces, moves, tangents, carried_tangents = (list[Array]() for _ in range(4))
    w, v = g, carried(g)
    first = whole = work = float(np.vdot(w, v))
    while len(moves) < most and work > CONVERGED * whole:
        forces.append(w / np.sqrt(work))
        moves.append(v / np.sqrt(work))
        tangent = product(moves[-1])
        if tangent is None:
            return Steps(np.full_like(g, np.inf), np.zeros_like(g), -np.inf)
        w, v = tangent, carried(tangent)
        tangents.append(w)
        carried_tangents.append(v)
        whole = float(np.vdot(w, v))
        for force, move in zip(forces, moves, strict=True):
            share = float(np.vdot(move, w))
            w, v = w - share * force, v - share * move
        work = float(np.vdot(w, v))
    if not moves:
        return Steps(np.zeros_like(g), np.zeros_like(g), np.inf)
    ritz = np.array([[np.vdot(a, b) for b in tangents] for a in moves])
    ritz = (ritz + ritz.T) / 2
    if not np.isfinite(ritz).all():
        return Steps(np.full_like(g, np.inf), np.zeros_like(g), -np.inf)
    y = np.linalg.solve(ritz, [np.sqrt(first), *[0.0] * (len(moves) - 1)])
    rest = np.sqrt(first) * moves[0] - np.tensordot(y, carried_tangents, 1)
    return Steps(np.tensordot(y, moves, 1), rest, float(np.linalg.eigvalsh(ritz)[0]))
