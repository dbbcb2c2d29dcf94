"""Displacement fields of sought parameters, and their derivatives: by predictions, or exactly."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.errors import WorkError
from surrogate.identification.least_squares import Model
from surrogate.identification.unknowns import Unknowns
from surrogate.touch import body as touch

Array = NDArray[np.float64]

DIFFERENCE = 3e-3  # of a change that matters


class Body(touch.Body, Protocol):
    """What is identified, such as a `Surrogate`."""

    def certify(self, forces: Any, predicted: Any, *, pressure: Any = None) -> Any:
        """Certificate of a displacement, whose `error` is in m."""

    def descend(self, dead: Any, pressure: Any, predicted: Any, aim: Any) -> Any:
        """Displacement in m that directions drive to the equilibrium, and how they end."""

    def correct(self, forces: Any, *, pressure: Any = None) -> Any:
        """Equilibrium under nodal forces in N, whose `displacement` is in m."""


class Response(ABC):
    """Displacements of the body, and at the markers, of some parameters θ.

    Parameters
    ----------
    body : Surrogate
    unknowns : Unknowns
    at_markers : csr_array, (m, n_nodes)
    scale : array, (p,)
        Sizes of changes of θ that matter.
    shift : array, (n_nodes, d) or number
        What is added to the displacements in m, such as the negative of their estimated error.
    """

    def __init__(
        self,
        body: Body,
        unknowns: Unknowns,
        at_markers: csr_array,
        scale: Array,
        shift: Array | float = 0.0,
    ) -> None:
        self.body, self.unknowns, self.scale = body, unknowns, scale
        self._at_markers, self._shift = at_markers, shift

    @property
    def model(self) -> Model:
        """What is measured."""
        return Model(lambda theta: self.field(theta) + self._shift, self.slopes, self._seen)

    @abstractmethod
    def field(self, theta: Array) -> Array:
        """u(θ) in m, (n_nodes, d)."""

    @abstractmethod
    def slopes(self, theta: Array, field: Array) -> Array:
        """∂u/∂θ, (n_nodes, d, p)."""

    def forces(self, theta: Array) -> Array:
        """Dead forces of u(θ) in N, (n_nodes, d)."""
        return self.unknowns.forces(theta)

    def _seen(self, fields: Array) -> Array:
        nodes = len(fields)
        found = self._at_markers @ fields.reshape(nodes, -1)
        return np.asarray(found.reshape(-1, *fields.shape[1:]))


class PredictedResponse(Response):
    """Predictions, and their forward differences."""

    def field(self, theta: Array) -> Array:
        """u(θ) in m."""
        return np.asarray(self.body.predict(self.unknowns.forces(theta)))

    def slopes(self, theta: Array, field: Array) -> Array:
        """∂u/∂θ."""
        steps = DIFFERENCE * self.scale
        ahead = np.asarray(self.body.predict(self.unknowns.forces(theta + np.diag(steps))))
        return differences(ahead, field - self._shift, steps)


class ExactResponse(Response):
    r"""Equilibria of the finite elements, and :math:`∂u/∂θ = K(u)^{-1} ∂f/∂θ`."""

    def field(self, theta: Array) -> Array:
        """u(θ) in m."""
        forces, pressure = self.unknowns.forces(theta), self.body.geometry.no_pressure
        return np.asarray(self.body.correct(forces, pressure=pressure).displacement)

    def slopes(self, theta: Array, field: Array) -> Array:
        """∂u/∂θ; WorkError if the equilibrium is not stable."""
        body = self.body.equilibrium
        f = body.forces_at_points(self.unknowns.forces(theta)[None])
        respond = body.response_at(body.at_points(field[None], f)[0])
        if respond is None:
            raise WorkError("the equilibrium that fits the markers is not stable")
        rates = respond(body.forces_at_points(self.unknowns.slopes(theta)))
        return np.asarray(np.moveaxis(rates[:, : body.nodes], 0, -1))


def differences(ahead: Array, field: Array, steps: Array) -> Array:
    """Forward differences of fields, (p, n_nodes, d), by steps of θ, (p,): (n_nodes, d, p)."""
    return np.moveaxis((ahead - field) / steps[:, None, None], 0, -1)
