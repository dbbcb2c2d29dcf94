r"""Certificates: how wrong a predicted displacement is, computed without the true one.

The forces of a prediction u are out of balance by r(u), and one step of Newton's method estimates
its error to second order:

.. math:: u - u_{true} = -δ(u) + O(‖u - u_{true}‖^2), \qquad δ(u) = -K(u)^{-1} r(u)

(`surrogate.mechanics.equilibrium`). The step has no such meaning where a cell is inverted, since
the strain energy is not defined there, or where K(u) is not positive definite, since no stable
equilibrium is near; such predictions are never certified.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.equilibrium import Equilibrium

Array = NDArray[np.float64]


@dataclass(frozen=True)
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
    stable : array of bool, () or (N,)
        True if the tangent K(u) is positive definite.
    """

    out_of_balance: Array
    error: Array
    relative_error: Array
    inverted: NDArray[np.int64]
    stable: NDArray[np.bool_]

    @property
    def mean_error(self) -> Array:
        """Mean absolute component of the estimated error in m, as the paper's measure e_m."""
        result: Array = np.abs(self.error).mean(axis=(-2, -1))
        return result

    @property
    def max_error(self) -> Array:
        """Largest length of the estimated error of a node in m."""
        result: Array = np.linalg.norm(self.error, axis=-1).max(axis=-1)
        return result

    def certified(self, tolerance: float) -> NDArray[np.bool_]:
        """True where `max_error` is at most `tolerance` in m, and `stable`."""
        return np.asarray((self.max_error <= tolerance) & self.stable)

    def summary(self) -> str:
        """Describe the estimated error of a single prediction in a line."""
        if self.inverted:
            return f"{self.inverted} inverted elements, no estimate of the error"
        return (
            f"estimated error {_length(float(self.mean_error))} in the mean, "
            f"{_length(float(self.max_error))} at most, "
            f"forces out of balance by {float(self.out_of_balance):.2g} of the load"
        )

    def refusal(self, tolerance: float) -> str | None:
        """Say why a single prediction is not certified; None if it is."""
        if self.inverted:
            return f"{self.inverted} inverted elements"
        if not self.max_error <= tolerance:
            return f"estimated error {_length(float(self.max_error))} > {_length(tolerance)}"
        return None if self.stable else "no stable equilibrium is near, the tangent is indefinite"


def certify(equilibrium: Equilibrium, forces: Array, predicted: Array) -> Certificate:
    """Estimate the errors of predictions.

    Parameters
    ----------
    equilibrium : Equilibrium
    forces, predicted : array, (n_nodes, d) or (N, n_nodes, d)
        Nodal forces in N, and predicted displacements in m. What is predicted for clamped nodes is
        wholly an error.
    """
    shape = predicted.shape
    f, u = (field.reshape(-1, *shape[-2:]) for field in (forces, predicted))
    held = np.where(equilibrium.free[:, None], u, 0.0)
    inverted = equilibrium.inverted(held)
    r = equilibrium.out_of_balance(held, f)
    residual = np.where(inverted == 0, _norms(r), np.inf)
    sound = np.flatnonzero(np.isfinite(residual))
    steps, stable = np.zeros(u.shape), np.zeros(len(u), dtype=bool)
    steps[sound], stable[sound] = equilibrium.newton_steps(held[sound], r[sound])
    error, truth = np.full(u.shape, np.inf), np.zeros(u.shape)
    truth[sound] = held[sound] + steps[sound]
    error[sound] = u[sound] - truth[sound]
    return Certificate(
        out_of_balance=_ratio(residual, _norms(f * equilibrium.free[:, None])).reshape(shape[:-2]),
        error=error.reshape(shape),
        relative_error=_ratio(_norms(error), _norms(truth)).reshape(shape[:-2]),
        inverted=inverted.reshape(shape[:-2]),
        stable=stable.reshape(shape[:-2]),
    )


def _norms(fields: Array) -> Array:
    norms: Array = np.sqrt(np.square(fields).sum(axis=(1, 2)))
    return norms


def _ratio(part: Array, whole: Array) -> Array:
    """Quotient of non-negative numbers, 0 if both are 0."""
    result: Array = np.where(part == 0, 0.0, np.inf)
    return np.divide(part, whole, out=result, where=whole > 0)


def _length(metres: float) -> str:
    return f"{metres * 1e3:.3g} mm"
