r"""What the surface of a body does from frame to frame beyond its linear response.

A tool often goes on as it did. Where it moves by a part ρ of its last move, in which forces changed
by S and displacements by Y, the body does so too, and bends as far as it did: it moves by

.. math:: δu = C \, δf + ρ (Y - C S) + \tfrac12 ρ (ρ + 1) c.

The bend c becomes :math:`ρ^2 c` and what the first prediction shows beyond that. For equal moves
this is the parabola through the last three frames, as for grips (`surrogate.touch.force_search`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surrogate.touch.force_search import part_of
from surrogate.touch.linear_body import LinearBody

Array = NDArray[np.float64]


class Bend:
    """The bend of the last frames.

    Parameters
    ----------
    body : LinearBody
    n_nodes, dimension : int
        Of its surface.
    """

    def __init__(self, body: LinearBody, n_nodes: int, dimension: int) -> None:
        self._body, self._moved = body, np.zeros(n_nodes)
        self._change = self._effect = self._bend = np.zeros((n_nodes, dimension))
        self._next, self._ratio, self._expected = self._moved, 0.0, self._bend

    def expected(self, moved: Array) -> Array:
        """Displacement in m of the surface, (n, d), beyond the linear one, as the tool moves.

        The move is the change of its distances in m to the nodes that bear forces, (n,).
        """
        ratio, nodes = part_of(moved, self._moved), np.flatnonzero(self._change.any(axis=1))
        lack = self._effect - self._body.moved(nodes, self._change[nodes])
        self._next, self._ratio = moved, ratio
        self._expected = ratio * lack + ratio * (ratio + 1) / 2 * self._bend
        return np.asarray(self._expected)

    def learn(self, lack: Array, change: Array, effect: Array) -> None:
        """Learn from a frame.

        Parameters
        ----------
        lack : array, (n, d)
            Displacement in m by its first prediction, beyond the linear one.
        change, effect : array, (n, d)
            How forces in N and displacements in m have changed.
        """
        self._bend = self._ratio**2 * self._bend + lack - self._expected
        self._moved, self._change, self._effect = self._next, change, effect
