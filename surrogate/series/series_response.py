r"""The response of the body to forces on the grid, to some order in the load.

.. math::
    U = A \sum_{k=1}^n c_k u_k, \qquad u_1 = K^{-1} f, \qquad
    u_k = -K^{-1} \sum_q w_q \, \hat P_{k,q} G_a, \qquad k = 2, …, n

with the part P̂ₖ of the k-th term of the stress that follows from u₁ … uₖ₋₁
(`surrogate.series.stress_series`) and the gradients G of the shape functions. The terms
are those of `surrogate.series.body_series`, on any device. They are in double precision
if K⁻¹ is dense: errors of single precision are rough, with much energy. Those of a large body are
smaller than a network's, and single precision takes half the time. The coefficients c, near 1 under
moderate loads, are those of the least potential energy (`surrogate.series.least_energy`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor, nn

from shared_schema.common.errors import InputError
from shared_schema.materials import Materials, NeoHookean
from surrogate.data.geometry import Geometry
from surrogate.mechanics.block_solve import SparseProduct
from surrogate.mechanics.compliance import Compliance
from surrogate.mechanics.linear_response import LinearResponse
from surrogate.mechanics.solids.zones import material_of_zones, weights_of_zones
from surrogate.series.least_energy import LeastEnergy
from surrogate.series.stress_series import SeriesStress, higher_terms

if TYPE_CHECKING:
    from surrogate.series.compiled_series import CompiledSeries

AT_ONCE = 2**19  # values of the search for the least energy that are held at once: in the cache
AT_ONCE_ON_GPU = 2**26
COMPILED = 2**15  # such values of one load, from which on compiled code takes less time
NEGLIGIBLE = 0.01  # gradients in units of the rounding of a number: what is beyond u₁, relative
COMPILES = find_spec("numba") is not None  # a machine that only trains may do without it


class CellOperators(nn.Module):
    """Gradients of displacements at the quadrature points, and forces of stresses there.

    Fields are (N, d, n_nodes), displacements in m and forces in N.

    Parameters
    ----------
    geometry : Geometry
    material : NeoHookean
    gradients : Tensor, (n_cells, n_points, n_corners, d)
        Of the shape functions; their precision is that of all fields.
    volumes : Tensor, (n_cells, n_points)
        Weights of the quadrature points (`surrogate.mechanics.solids.zones`).

    Attributes
    ----------
    shares : Tensor, (n_cells · n_points,)
        Weights over a power of two near their mean: energies of a body of micrometres would
        underflow in single precision.
    """

    cells: Tensor
    slopes: Tensor
    weighted: Tensor
    volumes: Tensor
    shares: Tensor

    def __init__(
        self, geometry: Geometry, material: NeoHookean, gradients: Tensor, volumes: Tensor
    ) -> None:
        super().__init__()
        self.material = material
        cells = torch.tensor(geometry.cells)
        self.register_buffer("cells", cells, persistent=False)
        count, points, corners, d = gradients.shape
        slopes = gradients.permute(0, 2, 1, 3).reshape(count, corners, points * d)
        weighted = (gradients * volumes[:, :, None, None]).permute(0, 1, 3, 2)
        self.register_buffer("slopes", slopes, persistent=False)
        self.register_buffer(
            "weighted", weighted.reshape(count, points * d, corners), persistent=False
        )
        self.register_buffer("volumes", volumes.flatten(), persistent=False)
        shares = self.volumes / 2.0 ** round(math.log2(volumes.double().mean()))
        self.register_buffer("shares", shares, persistent=False)
        nodes, places = geometry.cells.ravel(), np.arange(geometry.cells.size)
        shape = len(geometry.coordinates), geometry.cells.size
        incidence = csr_array((np.ones(geometry.cells.size), (nodes, places)), shape)
        self.sums = SparseProduct(incidence, gradients.dtype)

    def gradient(self, u: Tensor) -> Tensor:
        """∂u_i/∂x_j at the quadrature points: (N, d, n_nodes) → (N, d, d, n_points)."""
        count, corners, columns = self.slopes.shape
        samples, d, _ = u.shape
        rows = u.flatten(0, 1).T.contiguous()  # whole rows are fast to select
        at_corners = rows.index_select(0, self.cells.flatten()).reshape(count, corners, -1)
        h = torch.bmm(at_corners.transpose(1, 2), self.slopes)
        h = h.reshape(count, samples, d, columns // d, d)
        return h.permute(1, 2, 4, 0, 3).flatten(3)

    def forces(self, p: Tensor) -> Tensor:
        """Forces of stresses: (N, d, d, n_points) → (N, d, n_nodes).

        Every node sums what its cells have. ONNX Runtime would scatter what the cells have to the
        nodes on several threads, and lose some of it (its issue 18048).
        """
        samples, d, _, _ = p.shape
        count, columns, corners = self.weighted.shape
        flat = p.reshape(samples, d, d, count, columns // d).permute(3, 0, 1, 4, 2)
        at_corners = torch.bmm(flat.reshape(count, samples * d, columns), self.weighted)
        rows = at_corners.transpose(1, 2).reshape(count * corners, samples * d)
        sums = self.sums(rows)
        return sums.T.reshape(samples, d, sums.shape[0])


class SeriesResponse(LinearResponse):
    """Grid forces in N to the response in m to order n, and its gradients, on the grid.

    Parameters
    ----------
    geometry : Geometry
    material : ShippedMaterial, or tuple of some
        A Neo-Hookean one, or some that differ in Young's modulus alone.
    gradient : bool
        Also compute the gradients.
    order : int
        Order n.

    Attributes
    ----------
    precision : torch.dtype
        Of the terms.
    compiled : bool
        Whether compiled code computes the loads on a large body; it takes a third of the time.

    Raises
    ------
    InputError
        If the material is another one.
    """

    def __init__(
        self, geometry: Geometry, material: Materials, gradient: bool = True, order: int = 3
    ) -> None:
        reference = material_of_zones(material)
        if reference is None:
            raise InputError(
                "key 'network.skip' = 'series': expected a body of one Neo-Hookean material, or of "
                "some that differ in 'young_modulus' alone; 'model: reduced' has series of others"
            )
        super().__init__(geometry, material, gradient, torch.float64)
        assert isinstance(self.compliance, Compliance)
        solid = self.compliance.equilibrium.solid
        self.precision = torch.float64 if len(self.compliance.matrix) else torch.float32
        operators = solid.gradients.to(self.precision), weights_of_zones(solid).to(self.precision)
        self.higher = CellOperators(geometry, reference, *operators)
        self.order, self.compiled = order, COMPILES
        self._by_cells: CompiledSeries | None = None
        self._least_energy = LeastEnergy()
        values = order * geometry.dimension**2 * len(self.higher.volumes)
        self._values, self._is_small = values, values < COMPILED

    def at_nodes(self, force: Tensor) -> Tensor:
        """Respond at the nodes, in m, in the series' precision: (N, d, nx, ny[, nz]) → …."""
        return self.respond(self.to_nodes(force.flatten(2)).to(self.precision))

    def on_grid(self, nodal: Tensor) -> tuple[Tensor, Tensor]:
        """Return the response, and the gradients of u₁ and of the last term, d² channels each.

        The latter, of cₙ uₙ, has no scale.
        """
        nodal = nodal.to(self.precision)
        beyond, last = self.beyond_first(nodal)
        linear = self.slopes(nodal.float()) / self.gradient_rms
        return self.fields_on_grid((nodal + beyond).float(), linear, self.slopes(last.float()))

    def beyond_first(self, nodal: Tensor) -> tuple[Tensor, Tensor]:
        """Response beyond u₁, and its last term, at the nodes in m, of u₁: (N, d, n_nodes) each."""
        if torch.compiler.is_compiling():  # of an exported file
            return self._beyond(nodal)
        alone = self.compiled and not self._is_small and nodal.device.type == "cpu"
        alone = alone and not nodal.requires_grad  # compiled code has no gradients
        alone = alone and isinstance(self.compliance, Compliance)  # not while a file is exported
        if alone:
            return self._beyond_compiled(nodal)
        held = AT_ONCE if nodal.device.type == "cpu" else AT_ONCE_ON_GPU
        parts = [self._beyond(part) for part in torch.split(nodal, max(1, held // self._values))]
        totals, last = zip(*parts, strict=True)
        return torch.cat(totals), torch.cat(last)

    def terms(self, nodal: Tensor) -> tuple[list[Tensor], list[Tensor]]:
        """u₁, u₂, … in m, (N, d, n_nodes), and their gradients, (N, d, d, n_points), of u₁."""
        gradient = self.higher.gradient(nodal)
        series = SeriesStress(self.higher.material, gradient)
        terms, gradients = higher_terms(series, self.order, self.higher.gradient, self.balanced)
        return [nodal, *terms], [gradient, *gradients]

    def _beyond(self, nodal: Tensor) -> tuple[Tensor, Tensor]:
        shape = nodal.shape
        beyond, last = beyond_linear(
            self.higher.material,
            self.higher.shares,
            self.order,
            nodal.flatten(1),
            lambda u: self.higher.gradient(u.reshape(shape)),
            lambda stress: self.balanced(stress).flatten(1),
            self._least_energy,
        )
        return beyond.reshape(shape), last.reshape(shape)

    def _beyond_compiled(self, nodal: Tensor) -> tuple[Tensor, Tensor]:
        """The same, compiled."""
        beyond, last = self.by_cells(nodal.transpose(1, 2).contiguous().numpy())
        return torch.from_numpy(beyond).transpose(1, 2), torch.from_numpy(last).transpose(1, 2)

    @property
    def by_cells(self) -> CompiledSeries:
        """The compiled response of a body on the CPU."""
        if self._by_cells is None:
            from surrogate.series.compiled_series import CompiledSeries  # Numba: half a second

            assert isinstance(self.compliance, Compliance)
            solid, respond = self.compliance.equilibrium.solid, self.compliance.respond_at_nodes
            kind = np.float64 if self.precision == torch.float64 else np.float32
            self._by_cells = CompiledSeries(solid, kind, respond, self.order)
        return self._by_cells

    def balanced(self, stress: Tensor) -> Tensor:
        """Displacements that balance stresses: (N, d, d, n_points) → (N, d, n_nodes)."""
        return -self.respond(self.higher.forces(stress))


def beyond_linear(
    material: NeoHookean,
    volumes: Tensor,
    order: int,
    first: Tensor,
    gradient: Callable[[Tensor], Tensor],
    balanced: Callable[[Tensor], Tensor],
    least_energy: LeastEnergy,
) -> tuple[Tensor, Tensor]:
    """Return Σₖ cₖ uₖ - u₁ and the last term cₙ uₙ in m, (…, n_dofs) each, of u₁.

    Both are zero under loads so small that they are less than the rounding errors of u₁, where
    products of the gradients could leave the range of numbers.

    Parameters
    ----------
    material : NeoHookean
    volumes : Tensor, (n_points,)
        Of the quadrature points, in any unit.
    order : int
        Order n, 2 at least.
    first : Tensor, (…, n_dofs)
        u₁ in m.
    gradient : callable
        Displacements in m to their gradients, (…, n_dofs) → (…, d, d, n_points).
    balanced : callable
        Stresses in Pa to the displacements that balance them, (…, d, d, n_points) → (…, n_dofs).
    least_energy : LeastEnergy
        Search for the coefficients.
    """
    slope = gradient(first)
    largest = slope.abs().flatten(-3).amax(-1)
    seen = (largest == 0) | (largest > NEGLIGIBLE * torch.finfo(slope.dtype).eps)
    first, slope = first * seen[..., None], slope * seen[..., None, None, None]
    terms, slopes = higher_terms(SeriesStress(material, slope), order, gradient, balanced)
    every = torch.stack([first, *terms], -2)
    c = least_energy(material, volumes, [slope, *slopes])
    last = c[..., -1:].to(first) * terms[-1]
    beyond = c - torch.eye(1, order, dtype=c.dtype, device=c.device)[0]
    return (beyond.to(first)[..., None, :] @ every)[..., 0, :], last
