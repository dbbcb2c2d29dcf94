r"""Full certificates: the error of a predicted displacement, computed without the true one.

The forces of a prediction u are out of balance by r(u), and one step of Newton's method with one
simplified step after it estimate its error to third order:

.. math:: u - u_{true} = -(δ + \bar δ) + O(‖u - u_{true}‖^3), \qquad
          δ = -K(u)^{-1} r(u), \quad \bar δ = -K(u)^{-1} r(u + δ)

(`surrogate.mechanics.equilibrium.out_of_balance`). The estimate is settled if K(u) is positive
definite, the contraction :math:`Θ = ‖\bar δ‖ / ‖δ‖` is at most 1/4, and :math:`\bar δ` is at most a
tenth of the estimate, or negligible. A third step with the same factorisation, which is no part of
the estimate, must be at most a quarter of :math:`\bar δ` too, or a thousandth of the estimate. It
is settled as well if r is no more than rounding errors. Otherwise the state is first improved by
Newton's method with line search (`surrogate.mechanics.certify.correction`), by 20 steps at most.
Then δ itself must be at most a tenth of the estimate, not only :math:`\bar δ`, since these steps
may have led far from the prediction. A prediction whose estimate does not settle is never
certified, nor is one with an inverted cell, for which there is no estimate.

Quadratic elements have points between the nodes, at which nothing is predicted: they move to where
they are in equilibrium (`surrogate.mechanics.equilibrium.quadratic`). Errors are those of the
nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.units import SI, Units
from surrogate.mechanics.certify.correction import damped, searched
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.newton_steps import norms
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium

Array = NDArray[np.float64]
LAST_PART = 0.1  # largest part of its last step in it
NEGLIGIBLE = 1e-9  # of the displacement: steps of this size may be rounding errors
ROUNDS = 20


@dataclass(frozen=True, repr=False)
class Certificate:
    """Estimated errors of one prediction, or of N (then every array has N as its first axis).

    Attributes
    ----------
    out_of_balance : array, () or (N,)
        ‖r(u)‖₂ / ‖f‖₂ over the free degrees of freedom.
    error : array, (n_nodes, d) or (N, n_nodes, d)
        Estimate of the predicted minus the true displacement in m; infinite if a cell is inverted.
    relative_error : array, () or (N,)
        ‖error‖₂ / ‖estimate of the true displacement‖₂.
    inverted : array of int, () or (N,)
        Number of inverted cells.
    settled : array of bool, () or (N,)
        True if Newton's method contracts, so that the estimate is to be trusted.
    units : Units
        Their labels, for messages.
    """

    out_of_balance: Array
    error: Array
    relative_error: Array
    inverted: NDArray[np.int64]
    settled: NDArray[np.bool_]
    units: Units = SI

    @property
    def mean_error(self) -> Array:
        """Mean absolute component of the estimated error in m, as the paper's measure e_m."""
        return np.asarray(np.abs(self.error).mean(axis=(-2, -1)))

    @property
    def max_error(self) -> Array:
        """Largest length of the estimated error of a node in m."""
        return np.asarray(np.linalg.norm(self.error, axis=-1).max(axis=-1))

    @checked_arguments
    def certified(self, tolerance: float) -> NDArray[np.bool_]:
        """True where `max_error` is at most `tolerance` in m, and `settled`."""
        return np.asarray((self.max_error <= tolerance) & self.settled)

    def __repr__(self) -> str:
        """Describe the error."""
        return f"Certificate({self.summary()})"

    def summary(self) -> str:
        """Describe the estimated error in a line; of several predictions, means and largest."""
        count, sound = self.inverted.size, self.inverted == 0
        unsettled = int((sound & ~self.settled).sum())
        several = self.inverted.ndim > 0
        estimated = "" if sound.all() else f", {sound.sum()} of them with an estimate"
        parts = [f"{count} predictions{estimated}"] if several else []
        if sound.any():
            length, ratio = self.units.written, float(self.out_of_balance[sound].max())
            of_load = f"{100 * ratio:.2g}% of" if ratio < 1 else f"{ratio:.3g} times"
            parts += [
                "estimated error on this mesh "
                f"{length(float(self.mean_error[sound].mean()))} in the mean",
                f"{length(float(self.max_error[sound].max()))} at most",
                f"forces out of balance by {of_load} the load",
            ]
        if unsettled:
            of_them = f"{unsettled} estimates do" if several else "the estimate does"
            parts.append(f"{of_them} not settle")
        if not sound.all():
            of_them = f" in {(~sound).sum()} of them" if several else ""
            parts.append(f"{self.inverted.sum()} inverted elements{of_them}")
            if not several:
                parts.append("no estimate of the error")
        return ", ".join(parts)

    @checked_arguments
    def refusal(self, tolerance: float) -> str | None:
        """Say why a prediction is not certified, of several the first such; None if all are."""
        refused = np.flatnonzero(~self.certified(tolerance))
        if len(refused) == 0:
            return None
        inverted, largest = self.inverted.flat[refused[0]], self.max_error.flat[refused[0]]
        if inverted:
            reason = f"{inverted} inverted elements"
        elif not largest <= tolerance:
            most = self.units.written(tolerance)
            reason = f"estimated error {self.units.written(float(largest))} > {most}"
        else:
            reason = (
                "the estimate does not settle, no stable equilibrium is near (a force on one node "
                "alone strains a fine mesh without bound)"
            )
        if self.inverted.ndim == 0:
            return reason
        count = f"{len(refused)} of {self.inverted.size} predictions"
        return f"{count}; number {refused[0]}: {reason}"


def certify(
    equilibrium: Equilibrium,
    forces: Array,
    predicted: Array,
    following: FollowingLoads | None = None,
) -> Certificate:
    """Estimate the errors of predictions.

    Parameters
    ----------
    equilibrium : Equilibrium
    forces, predicted : array, (n_nodes, d) or (N, n_nodes, d)
        Dead loads in N, those between the nodes after the nodal ones, and predicted displacements
        in m. What is predicted for clamped nodes is wholly an error.
    following : FollowingLoads, optional
        Pressures of every load case.
    """
    f, u = (fields.reshape(-1, *fields.shape[-2:]) for fields in (forces, predicted))
    together = [(equilibrium, slice(None))]
    if following is not None:
        rows = [slice(row, row + 1) for row in range(max(1, len(u)))]
        together = [(equilibrium.under(following[row]), row) for row in rows]
    parts = zip(*(_certified(body, f[row], u[row]) for body, row in together), strict=True)
    shape = predicted.shape[:-2]
    joined: list[Any] = [np.concatenate(part) for part in parts]
    arrays = [array.reshape((*shape, *array.shape[1:])) for array in joined]
    return replace(Certificate(*arrays), units=equilibrium.units)


def _certified(equilibrium: Equilibrium, load: Array, u: Array) -> tuple[NDArray[Any], ...]:
    """Arrays of the certificates of N predictions."""
    return _at_points(equilibrium, *equilibrium.posed(load, u), u)


def certified_at_points(equilibrium: Equilibrium, force: Array, u: Array) -> Certificate:
    """The same of one state of all points under forces on these: (n_points, d) in N and m."""
    f, at_points = force[None], u[None]
    found = _at_points(equilibrium, f, at_points, at_points[:, : equilibrium.nodes])
    return replace(Certificate(*(array[0] for array in found)), units=equilibrium.units)


def _at_points(equilibrium: Equilibrium, f: Array, held: Array, u: Array) -> tuple[Any, ...]:
    """Arrays of the certificates of predictions u at the nodes, which are `held` at all points."""
    inverted = equilibrium.inverted(held)
    residual = np.where(inverted == 0, norms(equilibrium.out_of_balance(held, f)), np.inf)
    sound = np.flatnonzero(np.isfinite(residual))
    truth, settled = np.zeros(held.shape), np.zeros(len(u), dtype=bool)
    truth[sound], settled[sound] = _settled(equilibrium, f[sound], held[sound])
    truth, error = truth[:, : equilibrium.nodes], np.full(u.shape, np.inf)
    error[sound] = u[sound] - truth[sound]
    out = _ratio(residual, norms(equilibrium.at_rest(f) * equilibrium.free))
    return out, error, _ratio(norms(error), norms(truth)), inverted, settled


def _settled(equilibrium: Equilibrium, f: Array, u: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Step from predictions until Newton's method contracts: the estimates of the truth."""
    truth, going = equilibrium.relaxed(u, f), np.arange(len(u))
    settled, improved = np.zeros(len(u), dtype=bool), equilibrium.mean_dilation
    for _ in range(ROUNDS):
        found = equilibrium.newton_steps(truth[going], f[going])
        # Improved states must be closer: their first step counts as the last part, not the second.
        last = norms(found.steps if improved else found.simplified)
        error = norms(u[going] - truth[going] - found.steps)
        small = found.contract(error) & (last <= LAST_PART * error)
        size, residual = norms(truth[going]), equilibrium.out_of_balance(truth[going], f[going])
        rounding = equilibrium.round_off
        hidden = norms(residual) <= rounding.at_rest + rounding.per_displacement * size
        contracts = found.stable & (small | hidden | (last <= NEGLIGIBLE * size))
        truth[going[contracts]] += (found.steps + found.simplified)[contracts]
        settled[going[contracts]] = True
        for row, step in zip(going[~contracts], found.steps[~contracts], strict=True):
            one = slice(row, row + 1)
            r = equilibrium.out_of_balance(truth[one], f[one])
            if equilibrium.has_potential:
                advanced = searched(equilibrium, f[one], truth[one], r, step[None])
            else:
                advanced = damped(equilibrium, f[one], truth[one], r)
            if advanced is not None:
                truth[one] = advanced[0]
        going, improved = going[~contracts], True
        if len(going) == 0:
            break
    return truth, settled


def _ratio(part: Array, whole: Array) -> Array:
    """Quotient of non-negative numbers, 0 if both are 0."""
    limit = np.where(part == 0, 0.0, np.inf)
    return np.divide(part, whole, out=limit, where=whole > 0)
