"""Steps of conjugate gradients towards K x = f, and what they tell about the definiteness of K."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.array_library import library_of
from shared_schema.common.bodies.polar_decomposition import Values

CONVERGED = 1e-10  # of the first work r · P r: smaller ones are rounding errors
Array = NDArray[np.float64]


class ConjugateGradients:
    """Steps from x = 0, of N systems at once, with one preconditioner P that whoever steps applies.

    Fields are (d, n_nodes, N), of NumPy or PyTorch.

    Parameters
    ----------
    force : array
        f.

    Attributes
    ----------
    x : array
    force : array
        What x leaves of f.
    works, curvatures, growths : list of array, (N,)
        Of every step: r · P r, p · K p, and the part of the direction p before in the next one.
    """

    def __init__(self, force: Values) -> None:
        library = library_of(force)
        self.force, self.x = force, library.zeros_like(force)
        self._direction: Values | None = None
        self.works: list[Values] = []
        self.curvatures: list[Values] = []
        self.growths: list[Values] = []

    @property
    def coefficients(self) -> tuple[list[Values], ...]:
        """What `smallest_ritz_value` takes, a list for each."""
        return self.works, self.curvatures, self.growths

    def step(self, z: Values, tangent_of: Callable[[Values], Values]) -> None:
        """Take a step.

        Parameters
        ----------
        z : array
            P times `force`.
        tangent_of : callable
            Product with K.
        """
        library, first = library_of(z), self._direction is None
        work: Values = (self.force * z).sum((0, 1))
        growth, direction = 0 * work, z
        if self._direction is not None:
            growth = library.where(self.works[-1] > 0, work / self.works[-1], 0)
            direction = z + growth * self._direction
        tangent = tangent_of(direction)
        curvature: Values = (direction * tangent).sum((0, 1))
        length = work / curvature
        length = library.where((length > 0) & (length < np.inf), length, float(first))
        self.x = self.x + length * direction
        self.force = self.force - length * tangent
        self._direction = direction
        self.works.append(work)
        self.curvatures.append(curvature)
        self.growths.append(growth)


def smallest_ritz_value(works: Array, curvatures: Array, growths: Array) -> Array:
    """Smallest eigenvalue of the tridiagonal matrix of conjugate gradients, (N,).

    Parameters
    ----------
    works, curvatures, growths : array, (n_steps, N)
        r · P r, p · K p, and the part of the direction p before in the next one. Steps after
        convergence, where r is made of rounding errors, are left out.

    Returns
    -------
    array, (N,)
        +∞ if there is no step, −∞ if a number is not finite.
    """
    count, samples = works.shape
    left_out = np.logical_or.accumulate(works <= CONVERGED * works[0])
    inverse = curvatures / works  # of the lengths of the steps
    matrix = np.zeros((samples, count, count))
    for k in range(count):
        matrix[:, k, k] = inverse[k] + (growths[k] * inverse[k - 1] if k else 0)
        if k:
            beside = np.sqrt(growths[k]) * inverse[k - 1]
            matrix[:, k, k - 1] = matrix[:, k - 1, k] = np.where(left_out[k], 0, beside)
            matrix[:, k, k] = np.where(left_out[k], matrix[:, 0, 0], matrix[:, k, k])
    finite = np.isfinite(matrix).all(axis=(1, 2))
    found = np.full(samples, -np.inf)
    found[finite] = np.linalg.eigvalsh(matrix[finite])[:, 0]
    return np.where(left_out[0], np.inf, found)
