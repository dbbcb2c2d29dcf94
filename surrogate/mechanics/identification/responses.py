r"""Displacement fields of sought parameters, and their derivatives, by one of three ways.

Predictions give those of forces and of a tool. Those in equilibrium of the finite elements follow,
with the unit forces and pressures of the parameters, and with the internal forces :math:`f_z` of a
zone whose Young's modulus :math:`E_z = E_{z,0} \, e^{φ_z}` is sought, which are proportional to it,
from

.. math:: \frac{∂u}{∂θ} = K(u)^{-1} \Big(\frac{∂f}{∂θ} + \frac{∂f_p(u)}{∂θ}\Big), \qquad
          \frac{∂u}{∂φ_z} = -K(u)^{-1} f_z(u), \qquad
          f_z(u) = f_{int}(u; 2 E_z) - f_{int}(u; E_z).

The body is another one for all moduli of zones, so that there are no predictions of it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.errors import InputError, WorkError
from shared_schema.materials import Materials, YoungPoisson, as_tuple
from shared_schema.tools import Displaced
from surrogate.mechanics.certify.correction import correct, stable_state
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.identification.least_squares import Model
from surrogate.mechanics.identification.unknowns import Unknowns
from surrogate.mechanics.solids.solid import Solid
from surrogate.mechanics.statics.load import Load
from surrogate.mechanics.statics.prediction import Predictor
from surrogate.mechanics.touch.loaded_body import LoadedBody
from surrogate.mechanics.touch.touch import Touch, TouchFrame

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
        return load.dead if load.following is None else load.dead + load.following.load[0]

    def _seen(self, fields: Array) -> Array:
        nodes = len(fields)
        found = self._at_markers @ fields.reshape(nodes, -1)
        return np.asarray(found.reshape(-1, *fields.shape[1:]))


def differences(ahead: Array, field: Array, steps: Array) -> Array:
    """Forward differences of fields, (p, n_nodes, d), by steps of θ, (p,): (n_nodes, d, p)."""
    return np.moveaxis((ahead - field) / steps[:, None, None], 0, -1)


CONTACT = 1e-5  # tolerance of the contact: differences are not to see it
DIFFERENCE = 1e-2  # of a change that matters


class ToolResponse(Response):
    """Predictions with the tool at θ m from where it is given, and their forward differences.

    Parameters
    ----------
    touch : Touch
        Of the body, with the tolerance `CONTACT`; fits that follow one another share it.
    given
        As `Response` takes them.
    """

    difference = DIFFERENCE

    def __init__(self, touch: Touch, *given: Any) -> None:
        super().__init__(*given)
        self._touch = touch

    def field(self, theta: Array) -> Array:
        """u(θ) in m, or of N sets of parameters; NaN where no contact is found."""
        if theta.ndim == 2:
            return np.array([self.field(one) for one in theta])
        try:
            return self._frame(theta).displacement
        except (InputError, WorkError):  # the tool may not be there
            return np.full(self.predictor.body.geometry.coordinates.shape, np.nan)

    def load(self, theta: Array) -> Load:
        """Forces of the tool, and what is known."""
        dead = self._loaded.with_forces(self._frame(theta).force)
        return Load(dead, self.unknowns.following)

    def _frame(self, theta: Array) -> TouchFrame:
        assert self.unknowns.tool is not None
        tool = Displaced(self.unknowns.tool, tuple(map(float, theta)))
        return self._touch.move(tool, self._loaded)

    @property
    def _loaded(self) -> LoadedBody:
        load = Load(self.unknowns.known, self.unknowns.following)
        return LoadedBody(self.predictor, load)


START = "last moduli of the zones"


class EquilibriumResponse(Response):
    """Equilibria of the finite elements; parameters as in `Response`, of zones as well."""

    _last: Array | None = None  # equilibrium in m, from which that of other moduli is found
    _body: tuple[bytes, Equilibrium] | None = None

    def field(self, theta: Array) -> Array:
        """u(θ) in m; of zones NaN if no equilibrium is found."""
        body, load = self._at(theta), self.load(theta)
        if not self.unknowns.zones:
            start, _ = self.predictor.respond(load)
            return correct(body, load.dead, start).displacement
        forces, last = body.forces_at_points(load.cases.dead), self._last
        start = body.linear_response(body.at_rest(forces)) if last is None else last[None]
        if body.inverted(start)[0]:
            start = np.zeros_like(start)
        nodes = self.predictor.body.equilibrium.nodes
        try:
            self._last = found = stable_state(body, forces, start, START).displacement
        except WorkError:
            return np.full((nodes, forces.shape[2]), np.nan)
        return found[:nodes]

    def slopes(self, theta: Array, field: Array) -> Array:
        """∂u/∂θ; WorkError if the equilibrium is not stable."""
        body, unknowns = self._at(theta), self.unknowns
        f = body.forces_at_points(self.load(theta).cases.dead)
        u = body.at_points(field[None], f)
        respond = body.response_at(u[0])
        if respond is None:
            raise WorkError("the equilibrium that fits the markers is not stable")
        forces = [unit_forces(self.predictor.body.equilibrium, unknowns, u)]
        if unknowns.softens:
            forces = [np.exp(-theta[-1]) * forces[0], -body.external(u, f)]
        inside = body.solid.internal_forces(torch.from_numpy(u)).numpy()
        for number in range(len(theta) - len(unknowns.zones), len(theta)):
            twice = theta.copy()
            twice[number] += np.log(2.0)
            forces.append(inside - self._solid(twice).internal_forces(torch.from_numpy(u)).numpy())
        rates = respond(np.concatenate(forces))
        return np.asarray(np.moveaxis(rates[:, : self.predictor.body.equilibrium.nodes], 0, -1))

    def _at(self, theta: Array) -> Equilibrium:
        """The body with some moduli under the pressures; that of the last moduli is kept."""
        following = self.load(theta).following
        if not self.unknowns.zones:
            return self.predictor.body.under(following)
        key = theta[len(theta) - len(self.unknowns.zones) :].tobytes()
        if self._body is None or self._body[0] != key:
            geometry = self.predictor.body.equilibrium.geometry
            self._body = key, Equilibrium(geometry, self._materials(theta))
        return self._body[1] if following is None else self._body[1].under(following)

    def _solid(self, theta: Array) -> Solid:
        body = self.predictor.body.equilibrium
        geometry = body.geometry
        mesh = geometry.coordinates, geometry.cells, geometry.cell_type
        return type(body.solid)(*mesh, self._materials(theta), geometry.parts, geometry.fibres)

    def _materials(self, theta: Array) -> Materials:
        moduli = dict(zip(self.unknowns.zones, self.unknowns.young_moduli(theta), strict=True))
        return tuple(
            material.model_copy(update={"young_modulus": moduli[material.group]})
            if material.group in moduli
            else material
            for material in self.predictor.body.equilibrium.solid.materials
        )


def unit_forces(body: Equilibrium, unknowns: Unknowns, u: Array) -> Array:
    """Unit forces and pressures at a displacement of all points in m, (1, n_points, d).

    Returns
    -------
    array, (K + Q, n_points, d)
        In N, on all points.
    """
    forces = body.forces_at_points(unknowns.patterns)
    if unknowns.following is None:
        return forces
    units = replace(unknowns.following[slice(1, None)], coordinates=body.geometry.coordinates)
    pushed = units.forces(np.broadcast_to(u, (len(units.amplitudes), *u.shape[1:])))
    return np.concatenate([forces, pushed])


def moduli_of_zones(material: Materials, zones: tuple[str, ...]) -> Array:
    """Young's moduli at rest in Pa of some zones, (z,).

    Raises
    ------
    InputError
        If there is no such zone, or its material has none.
    """
    groups = {each.group: each for each in as_tuple(material)}
    found = []
    for zone in zones:
        each = groups.get(zone)
        if not isinstance(each, YoungPoisson):
            known = [g for g, m in groups.items() if g and isinstance(m, YoungPoisson)]
            listed = ", ".join(f"'{g}'" for g in known) or "none of this body"
            raise InputError(f"unknown: young-modulus:{zone}: expected a zone, {listed}")
        found.append(each.young_modulus)
    return np.array(found)
