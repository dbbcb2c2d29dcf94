r"""The response of the body to forces on the grid, to some order in the load.

.. math:: U = A \sum_{k=1}^n c_k u_k

with the load series of the body's own elements, materials and fibres
(`surrogate.mechanics.series.body_series`), on any device, with gradients, and in exported files. u₁
is in single precision on a large body without dense K⁻¹: its rounding errors are smaller than a
network's, and single precision takes half of the time.

A pressure that follows the surface is a part of the forces, as datasets hold them: those on the
undeformed body. That of a surface is the median of the pressures that explain the forces of its
nodes; it is exact if fewer than half of these have another force
(`surrogate.mechanics.statics.load.Load.of_samples`). Otherwise forces keep their direction.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy.sparse import csr_array, eye
from torch import Tensor

from shared_schema.materials import Materials
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.compliance import Compliance
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.linear_response import LinearResponse
from surrogate.mechanics.matrices.sparse_products import WeightedSums
from surrogate.mechanics.series.body_series import BodySeries
from surrogate.mechanics.series.following_terms import FollowingTerms

ROUNDING = 1e-4  # of a force that is told from that of a pressure, relative
LEAST_AREA = 1e-3  # of the largest one of a node, in tellings of pressures


class SeriesResponse(LinearResponse):
    """Grid forces in N to the response in m to order n, and its gradients, on the grid.

    Parameters
    ----------
    geometry : Geometry
    material : ShippedMaterial, or tuple of some
    gradient : bool
        Also compute the gradients.
    order : int
        Order n.

    Attributes
    ----------
    series : BodySeries
    precision : torch.dtype
        Of u₁.
    on_nodes : bool
        Whether elements have no points between the nodes, and loads no pressures that follow the
        surface, so that u₁ at the nodes tells all.
    """

    def __init__(
        self, geometry: Geometry, material: Materials, gradient: bool = True, order: int = 3
    ) -> None:
        super().__init__(geometry, material, gradient, torch.float64, on_points=True)
        compliance = self.compliance
        assert isinstance(compliance, Compliance)
        self.precision = torch.float64 if compliance.is_small else torch.float32
        self.order, self.equilibrium = order, compliance.equilibrium
        responses = self._respond_at_points, compliance.respond
        self.series = BodySeries(self.equilibrium, order, *responses, self.precision)
        self.on_points: WeightedSums | None = None
        if geometry.has_points_between:
            spread = csr_array(eye(len(self.equilibrium.free), self.nodes))
            self.on_points = WeightedSums(spread, torch.float64)  # no forces between the nodes
        self.pressed: PressedLoads | None = None
        if geometry.following:
            self.pressed = PressedLoads(geometry, self, self.equilibrium.geometry.coordinates)
        self.on_nodes = self.on_points is None and self.pressed is None

    def forward(self, force: Tensor, response: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Respond, as `LinearResponse` does: the gradients are those of u₁ and of the last term.

        The latter, of cₙ uₙ, has no scale.
        """
        return super().forward(force, response if self.on_nodes else None)

    def at_nodes(self, force: Tensor) -> Tensor:
        """u₁ at the nodes, in m, in its precision: (N, d, nx, ny[, nz]) → (N, d, n_nodes)."""
        return self.first(force)[0][:, :, : self.nodes]

    def fields(self, force: Tensor, response: Tensor | None) -> tuple[Tensor, Tensor]:
        """Fields of `forward`."""
        if response is not None:
            return self.on_grid(response)
        return self.on_grid(*self.first(force))

    def first(self, force: Tensor) -> tuple[Tensor, Tensor | None]:
        """u₁ at all points in m, and pressures: (N, d, nx, ny[, nz]) → (N, d, n_points)."""
        nodal, pressures = self.to_nodes(force.flatten(2)).to(self.precision), None
        if self.pressed is not None:
            nodal, pressures = self.pressed.told_apart(nodal.double())
        acting = nodal if self.on_points is None else self.on_points(nodal.double())
        units = None if self.pressed is None else self.pressed.units
        first = self.series.first(acting.to(self.precision).mT, units, pressures)
        return first.mT, pressures

    def on_grid(self, first: Tensor, pressures: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Return the fields on the grid, of u₁ at all points, and pressures (N, n_surfaces)."""
        beyond, last = self.beyond_first(first.to(self.precision), pressures)
        nodal, beyond, last = (field[:, :, : self.nodes] for field in (first, beyond, last))
        linear = self.slopes(nodal.float()) / self.gradient_rms
        return self.fields_on_grid((nodal + beyond).float(), linear, self.slopes(last.float()))

    def beyond_first(self, first: Tensor, pressures: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Response beyond u₁, and its last term, in m, of u₁: (N, d, n_points) each."""
        units = None if self.pressed is None else self.pressed.units
        beyond, last = self.series(first.mT, units, pressures)
        return beyond.mT, last.mT

    def _respond_at_points(self, forces: Tensor) -> Tensor:
        """K⁻¹ f, (N, n_points, d)."""
        response: Tensor = self.compliance(forces.to(self.precision))
        return response


class PressedLoads(torch.nn.Module):
    """Tells pressures that follow the surface from dead loads at the nodes.

    Tensions and pressures of actuators are those that make up the whole load; other loads beside
    them are dead ones.

    Parameters
    ----------
    geometry : Geometry
    response : LinearResponse
        Of the body: loads are its `to_nodes` of those on the grid.
    coordinates : array, (n_points, d)
        Positions of all points of the elements in m.
    """

    areas: Tensor
    inverse: Tensor

    def __init__(
        self, geometry: Geometry, response: LinearResponse, coordinates: np.ndarray
    ) -> None:
        super().__init__()
        self.units = FollowingTerms(coordinates, geometry.following)
        units = FollowingLoads.of(geometry, np.eye(len(geometry.following)))
        loads = units.load[:, : len(geometry.coordinates)] * geometry.free
        on_grid = torch.from_numpy(np.stack([geometry.grid.forces_to_grid(f) for f in loads]))
        areas = response.to_nodes(on_grid.flatten(2).float()).double()
        self.register_buffer("areas", areas, persistent=False)
        self.actuated = geometry.actuators is not None
        if self.actuated:
            inverse = torch.linalg.pinv(areas.flatten(1))
            self.register_buffer("inverse", inverse, persistent=False)
        sizes = areas.square().sum(1)
        touched = sizes > LEAST_AREA**2 * sizes.amax(1, keepdim=True)
        own = touched & (touched.sum(0) == 1)
        self.known = bool(own.any(1).all())
        for number, some in enumerate(own):
            nodes = some.nonzero()[:, 0]
            self.register_buffer(f"nodes_{number}", nodes, persistent=False)

    def told_apart(self, nodal: Tensor) -> tuple[Tensor, Tensor | None]:
        """Dead loads, and pressures in Pa: (N, d, n_nodes) in N → same, (N, n_surfaces)."""
        if self.actuated:
            flat = nodal.flatten(1)
            amplitudes = flat @ self.inverse
            rest = (flat - amplitudes @ self.areas.flatten(1)).square().sum(1, keepdim=True)
            follows = rest <= ROUNDING**2 * flat.square().sum(1, keepdim=True)
            amplitudes = torch.where(follows, amplitudes, torch.zeros_like(amplitudes))
            return nodal * ~follows[:, :, None], amplitudes
        if not self.known:
            return nodal, None
        found = []
        for number, area in enumerate(self.areas):
            nodes = self.get_buffer(f"nodes_{number}")
            a, f = area.index_select(1, nodes), nodal.index_select(2, nodes)
            each = ((f * a).sum(1) / a.square().sum(0)).sort(1).values
            count = each.shape[1]
            pressure = (each[:, (count - 1) // 2] + each[:, count // 2]) / 2
            rest = (f - pressure[:, None, None] * a).square().sum(1)
            loaded = rest > ROUNDING**2 * f.square().sum(1)
            follows = 2 * loaded.sum(1) < count
            found.append(torch.where(follows, pressure, torch.zeros_like(pressure)))
        pressures = torch.stack(found, 1)
        return nodal - (pressures @ self.areas.flatten(1)).reshape(nodal.shape), pressures
