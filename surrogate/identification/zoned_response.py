r"""Displacement fields of a body whose zones have sought Young's moduli, and their derivatives.

The stiffness of a zone is another body for every modulus, so these are equilibria of the finite
elements. Internal forces :math:`f_z` of a zone are proportional to its modulus
:math:`E_z = E_{z,0} \, e^{φ_z}`, so that

.. math:: \frac{∂u}{∂φ_z} = -K(u)^{-1} f_z(u), \qquad
          f_z(u) = f_{int}(u; 2 E_z) - f_{int}(u; E_z).
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from shared_schema.common.errors import InputError, WorkError
from shared_schema.materials import Materials, YoungPoisson, as_tuple
from surrogate.certify.correction import stable_state
from surrogate.identification.responses import Response, unit_forces
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.mechanics.solids.solid import Solid

Array = NDArray[np.float64]
START = "last moduli of the zones"


class ZonedResponse(Response):
    """Equilibria of the finite elements; parameters as in `Response`, of zones as well."""

    _last: Array | None = None  # equilibrium in m, from which the next one is found
    _body: tuple[bytes, Equilibrium] | None = None

    def field(self, theta: Array) -> Array:
        """u(θ) in m; NaN if no equilibrium is found."""
        body, dead = self._at(theta), self.unknowns.forces(theta)[None]
        forces = self.body.equilibrium.forces_at_points(dead)
        last = self._last
        start = body.linear_response(body.at_rest(forces)) if last is None else last[None]
        if body.inverted(start)[0]:
            start = np.zeros_like(start)
        try:
            self._last = found = stable_state(body, forces, start, START).displacement
        except WorkError:
            return np.full((self.body.equilibrium.nodes, forces.shape[2]), np.nan)
        return found[: self.body.equilibrium.nodes]

    def slopes(self, theta: Array, field: Array) -> Array:
        """∂u/∂θ; WorkError if the equilibrium is not stable."""
        body, zones = self._at(theta), self.unknowns.zones
        at_rest = self.body.equilibrium
        assert self._last is not None
        u = self._last[None]
        if not np.array_equal(u[0, : at_rest.nodes], field):
            self.field(theta)
            u = self._last[None]
        respond = body.response_at(u[0])
        if respond is None:
            raise WorkError("the equilibrium that fits the markers is not stable")
        inside = body.solid.internal_forces(torch.from_numpy(u)).numpy()
        forces = [unit_forces(at_rest, self.unknowns, u)]
        for number in range(len(zones)):
            twice = theta.copy()
            twice[len(theta) - len(zones) + number] += np.log(2.0)
            forces.append(inside - self._solid(twice).internal_forces(torch.from_numpy(u)).numpy())
        rates = respond(np.concatenate(forces))
        return np.asarray(np.moveaxis(rates[:, : at_rest.nodes], 0, -1))

    def _at(self, theta: Array) -> Equilibrium:
        """The body with some moduli under the pressures; that of the last moduli is kept."""
        key = theta[len(theta) - len(self.unknowns.zones) :].tobytes()
        if self._body is None or self._body[0] != key:
            self._body = key, Equilibrium(self.body.equilibrium.geometry, self._materials(theta))
        pressure = self.unknowns.pressure(theta)
        return self._body[1] if pressure is None else self._body[1].under(pressure)

    def _solid(self, theta: Array) -> Solid:
        body, geometry = self.body.equilibrium, self.body.equilibrium.geometry
        mesh = geometry.coordinates, geometry.cells, geometry.cell_type
        return type(body.solid)(*mesh, self._materials(theta), geometry.parts, geometry.fibres)

    def _materials(self, theta: Array) -> Materials:
        moduli = dict(zip(self.unknowns.zones, self.unknowns.young_moduli(theta), strict=True))
        return tuple(
            material.model_copy(update={"young_modulus": moduli[material.group]})
            if material.group in moduli
            else material
            for material in self.body.equilibrium.solid.materials
        )


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
