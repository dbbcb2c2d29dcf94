r"""The response of the body to forces on the grid, to some order in the load.

.. math::
    U = A \sum_{k=1}^n c_k u_k, \qquad u_1 = K^{-1} f, \qquad
    u_k = -K^{-1} \sum_q w_q \, \hat P_{k,q} G_a, \qquad k = 2, …, n

with the part P̂ₖ of the k-th term of the stress that follows from u₁ … uₖ₋₁
(`surrogate.series.stress_series`) and the gradients G of the shape functions. The terms
are those of `surrogate.series.load_series`, on any device. They are in double precision
if K⁻¹ is dense: errors of single precision are rough, with much energy. Those of a large body are
smaller than a network's, and single precision takes half the time. The coefficients c, near 1 under
moderate loads, are those of the least potential energy (`surrogate.series.least_energy`).
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from shared_schema.common.errors import InputError
from shared_schema.material import Materials, NeoHookean
from surrogate.data.geometry import Geometry
from surrogate.mechanics.compliance import Compliance
from surrogate.mechanics.linear_response import LinearResponse
from surrogate.series.best_response import beyond_linear
from surrogate.series.cell_operators import CellOperators
from surrogate.series.stress_series import SeriesStress, higher_terms

if TYPE_CHECKING:
    from surrogate.series.compiled_response import CompiledResponse

AT_ONCE = 2**19  # values of `least_energy` that are held at once: in the cache
COMPILES = find_spec("numba") is not None  # a machine that only trains may do without it


class SeriesResponse(LinearResponse):
    """Grid forces in N to the response in m to order n, and its gradients, on the grid.

    Parameters
    ----------
    geometry : Geometry
    material : ShippedMaterial, or tuple of some
        A single Neo-Hookean material.
    gradient : bool
        Also compute the gradients.
    order : int
        Order n.

    Attributes
    ----------
    precision : torch.dtype
        Of the terms.

    Raises
    ------
    InputError
        If the material is another one.
    """

    def __init__(
        self, geometry: Geometry, material: Materials, gradient: bool = True, order: int = 3
    ) -> None:
        if not isinstance(material, NeoHookean):
            raise InputError(
                "key 'network.skip' = 'series': expected a body of one Neo-Hookean material; "
                "'model: reduced' has series of other ones"
            )
        super().__init__(geometry, material, gradient, torch.float64)
        assert isinstance(self.compliance, Compliance)
        solid = self.compliance.equilibrium.solid
        self.precision = torch.float64 if len(self.compliance.matrix) else torch.float32
        operators = solid.gradients.to(self.precision), solid.volumes.to(self.precision)
        self.higher = CellOperators(geometry, material, *operators)
        self.order = order
        self._of_one: CompiledResponse | None = None
        values = order * geometry.dimension**2 * len(self.higher.volumes)
        self._at_once = max(1, AT_ONCE // values)

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

    def first_on_grid(self, nodal: Tensor) -> tuple[Tensor, Tensor]:
        """Return what `on_grid` does of u₁ alone: linear in the load."""
        nodal = nodal.float()
        linear = self.slopes(nodal) / self.gradient_rms
        return self.fields_on_grid(nodal, linear, torch.zeros_like(linear))

    def beyond_first(self, nodal: Tensor) -> tuple[Tensor, Tensor]:
        """Response beyond u₁, and its last term, at the nodes in m, of u₁: (N, d, n_nodes) each."""
        if torch.compiler.is_compiling():  # of an exported file
            return self._beyond(nodal)
        alone = COMPILES and self._at_once == 1 and nodal.device.type == "cpu"
        alone = alone and isinstance(self.compliance, Compliance)  # not while a file is exported
        beyond = self._beyond_of_one if alone else self._beyond
        parts = [beyond(part) for part in torch.split(nodal, self._at_once)]
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
            self.higher.volumes,
            self.order,
            nodal.flatten(1),
            lambda u: self.higher.gradient(u.reshape(shape)),
            lambda stress: self.balanced(stress).flatten(1),
        )
        return beyond.reshape(shape), last.reshape(shape)

    def _beyond_of_one(self, nodal: Tensor) -> tuple[Tensor, Tensor]:
        """The same of one load on a large body: compiled, it takes a third of the time."""
        found = self.of_one(nodal[0].T.contiguous().numpy())
        beyond, last = (torch.from_numpy(u).T[None] for u in found)
        return beyond, last

    @property
    def of_one(self) -> CompiledResponse:
        """The compiled response of a body on the CPU."""
        if self._of_one is None:
            from surrogate.series import compiled_response  # Numba: half a second

            assert isinstance(self.compliance, Compliance)
            self._of_one = compiled_response.CompiledResponse(
                self.higher, self.compliance, self.order
            )
        return self._of_one

    def balanced(self, stress: Tensor) -> Tensor:
        """Displacements that balance stresses: (N, d, d, n_points) → (N, d, n_nodes)."""
        return -self.respond(self.higher.forces(stress))
