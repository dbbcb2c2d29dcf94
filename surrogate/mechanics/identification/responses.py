"""Displacement fields of sought parameters, and their derivatives, by predictions."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from surrogate.mechanics.identification.least_squares import Model
from surrogate.mechanics.identification.unknowns import Unknowns
from surrogate.mechanics.statics.load import Load
from surrogate.mechanics.statics.prediction import Predictor

Array = NDArray[np.float64]

DIFFERENCE = 3e-3  # of a change that matters


class Response:
    """Displacements of the body, and at the markers, of some parameters θ: by predictions.

    Parameters
    ----------
    predictor : Predictor
    unknowns : Unknowns
    at_markers : csr_array, (m, n_nodes)
    scale : array, (p,)
        Sizes of changes of θ that matter.
    shift : array, (n_nodes, d) or number
        What is added to the displacements in m, such as the negative of their estimated error.
    """

    difference: ClassVar[float] = DIFFERENCE

    def __init__(
        self,
        predictor: Predictor,
        unknowns: Unknowns,
        at_markers: csr_array,
        scale: Array,
        shift: Array | float = 0.0,
    ) -> None:
        self.predictor, self.unknowns, self.scale = predictor, unknowns, scale
        self._at_markers, self._shift = at_markers, shift

    @property
    def model(self) -> Model:
        """What is measured."""
        return Model(lambda theta: self.field(theta) + self._shift, self.slopes, self._seen)

    def field(self, theta: Array) -> Array:
        """u(θ) in m, (n_nodes, d), or of N sets of parameters, (N, p), at once."""
        return self.predictor.respond(self.load(theta))[0]

    def slopes(self, theta: Array, field: Array) -> Array:
        """∂u/∂θ, (n_nodes, d, p), by forward differences."""
        steps = self.difference * self.scale
        return differences(self.field(theta + np.diag(steps)), field - self._shift, steps)

    def load(self, theta: Array) -> Load:
        """The load of u(θ)."""
        return self.unknowns.load(theta)

    def at_rest(self, theta: Array) -> Array:
        """Forces of u(θ) in N, with those of pressures on the undeformed body."""
        load = self.load(theta)
        return load.dead if load.pressure is None else load.dead + load.pressure.load[0]

    def _seen(self, fields: Array) -> Array:
        nodes = len(fields)
        found = self._at_markers @ fields.reshape(nodes, -1)
        return np.asarray(found.reshape(-1, *fields.shape[1:]))


def differences(ahead: Array, field: Array, steps: Array) -> Array:
    """Forward differences of fields, (p, n_nodes, d), by steps of θ, (p,): (n_nodes, d, p)."""
    return np.moveaxis((ahead - field) / steps[:, None, None], 0, -1)
