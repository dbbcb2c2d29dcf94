"""Predictions at some nodes of a large body alone, such as its surface, by reduced networks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surrogate.one_load.backend import TOGETHER, OneLoad
from surrogate.one_load.large_body import LargeBody
from surrogate.one_load.reduced_in_numpy import ReducedInNumPy

Array = NDArray[np.float64]


class SomeNodes:
    """The mean displacements of some nodes, from the rows of the modes that belong to them.

    Most of the time of a prediction on a large body is that of reading its modes.

    Parameters
    ----------
    one_load : OneLoad
        Prediction at all nodes, for which `fits` is true.
    nodes : array of int, (n,)
    """

    def __init__(self, one_load: OneLoad, nodes: NDArray[np.int64]) -> None:
        reduced, before = one_load.members[0], one_load.before
        assert isinstance(reduced, ReducedInNumPy)
        assert isinstance(before, LargeBody)
        self.one_load, self.reduced, self.before, self.nodes = one_load, reduced, before, nodes
        points, scales = one_load.sources[0][nodes], one_load.scales[0][nodes]
        by_point = reduced.modes.reshape(len(reduced.modes), -1, scales.shape[1])
        self.modes = (by_point[:, points] * scales).reshape(len(by_point), -1)

    @staticmethod
    def fits(one_load: OneLoad) -> bool:
        """Whether a reduced network predicts on a large body whose nodes are its grid points."""
        is_reduced = isinstance(one_load.members[0], ReducedInNumPy)
        before = one_load.before
        return is_reduced and isinstance(before, LargeBody) and before.compliance is not None

    def __call__(self, forces: Array) -> Array:
        """Predict displacements in m, (N, n, d), from forces at all nodes in N, (N, n_nodes, d)."""
        found = np.empty((len(forces), len(self.nodes), forces.shape[2]))
        for start in range(0, len(forces), TOGETHER):
            some = slice(start, start + TOGETHER)
            inputs, response = self.before(forces[some])
            left = self.reduced.amplitudes(inputs) @ self.modes
            found[some] = response[:, self.nodes] + left.reshape(found[some].shape)
        return found
