"""Displacement fields of sought parameters, and their derivatives: by predictions, or exactly."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.errors import WorkError
from surrogate.certify.correction import correct
from surrogate.identification.least_squares import Model
from surrogate.identification.unknowns import Unknowns
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.touch import body as touch

Array = NDArray[np.float64]

DIFFERENCE = 3e-3  # of a change that matters


class Body(touch.Body, Protocol):
    """What is identified, such as a `Surrogate`."""

    def under(self, pressure: Any) -> Equilibrium:
        """Equilibrium under dead loads, and pressures of one load case if there are."""


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
        """Dead forces of u(θ) in N, (n_nodes or n_points, d)."""
        return self.unknowns.forces(theta)

    def at_rest(self, theta: Array) -> Array:
        """Forces of u(θ) in N, with those of pressures on the undeformed body."""
        force, pressure = self.forces(theta), self.unknowns.pressure(theta)
        return force if pressure is None else force + pressure.load[0]

    def _seen(self, fields: Array) -> Array:
        nodes = len(fields)
        found = self._at_markers @ fields.reshape(nodes, -1)
        return np.asarray(found.reshape(-1, *fields.shape[1:]))


class PredictedResponse(Response):
    """Predictions, and their forward differences."""

    def field(self, theta: Array) -> Array:
        """u(θ) in m."""
        return predicted(self.body, self.unknowns, theta[None])[0]

    def slopes(self, theta: Array, field: Array) -> Array:
        """∂u/∂θ."""
        steps = DIFFERENCE * self.scale
        ahead = predicted(self.body, self.unknowns, theta + np.diag(steps))
        return differences(ahead, field - self._shift, steps)


class ExactResponse(Response):
    r"""Equilibria of the finite elements, and their slopes.

    .. math:: \frac{∂u}{∂θ} = K(u)^{-1} \Big(\frac{∂f}{∂θ} + \frac{∂f_p(u)}{∂θ}\Big)
    """

    def field(self, theta: Array) -> Array:
        """u(θ) in m."""
        unknowns, start = self.unknowns, predicted(self.body, self.unknowns, theta[None])[0]
        body = self.body.under(unknowns.pressure(theta))
        return correct(body, unknowns.forces(theta), start).displacement

    def slopes(self, theta: Array, field: Array) -> Array:
        """∂u/∂θ; WorkError if the equilibrium is not stable."""
        body, unknowns = self.body.under(self.unknowns.pressure(theta)), self.unknowns
        f = body.forces_at_points(unknowns.forces(theta)[None])
        u = body.at_points(field[None], f)
        respond = body.response_at(u[0])
        if respond is None:
            raise WorkError("the equilibrium that fits the markers is not stable")
        forces = unit_forces(body, unknowns, u)
        if unknowns.softens:
            forces = np.exp(-theta[-1]) * forces
            forces = np.concatenate([forces, -body.external(u, f)])
        rates = respond(forces)
        return np.asarray(np.moveaxis(rates[:, : body.nodes], 0, -1))


def predicted(body: Body, unknowns: Unknowns, thetas: Array) -> Array:
    """u(θ) in m by predictions, of N sets of parameters: (N, p) → (N, n_nodes, d)."""
    return touch.predicted(body, unknowns.forces(thetas), unknowns.pressure(thetas))


def unit_forces(body: Equilibrium, unknowns: Unknowns, u: Array) -> Array:
    """Unit forces and pressures at a displacement of all points in m, (1, n_points, d).

    Returns
    -------
    array, (K + Q, n_points, d)
        In N, on all points.
    """
    forces = body.forces_at_points(unknowns.patterns)
    if unknowns.pressures is None:
        return forces
    units = replace(unknowns.pressures[slice(1, None)], coordinates=body.geometry.coordinates)
    pushed = units.forces(np.broadcast_to(u, (len(units.pressures), *u.shape[1:])))
    return np.concatenate([forces, pushed])


def differences(ahead: Array, field: Array, steps: Array) -> Array:
    """Forward differences of fields, (p, n_nodes, d), by steps of θ, (p,): (n_nodes, d, p)."""
    return np.moveaxis((ahead - field) / steps[:, None, None], 0, -1)
