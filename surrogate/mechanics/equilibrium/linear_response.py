r"""The linear response of the undeformed body to forces on the grid.

.. math:: U_{lin} = A K^{-1} A^T F

K is the stiffness of the undeformed body with its supports. A takes nodal displacements to the grid
(`shared_schema.grid`), and its transpose takes forces from the grid to nodes with the same work. On
a grid whose points are nodes this is :math:`u_{lin} = K^{-1} f` itself. On an embedded grid the
force of a grid point is distributed over the nodes around it.

The gradient of a nodal field is the mean of its gradients in the cells that meet at a node,

.. math:: \frac{∂u_i}{∂x_j}(x_a) ≈
   \frac{1}{|C_a|} \sum_{c ∈ C_a} \sum_b \frac{∂N_b^c}{∂x_j}(x_a) \, u_{ib}

with the cells :math:`C_a` at node a and their shape functions :math:`N_b^c`; it is exact for linear
fields.
"""

from __future__ import annotations

import hashlib

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from torch import Tensor, nn

from shared_schema.common.bodies.reference_cells import CORNERS
from shared_schema.common.errors import InputError
from shared_schema.materials import Materials
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.block_solve import BlockSolve
from surrogate.mechanics.equilibrium.compliance import Compliance
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.matrices.sparse_products import WeightedSums, matrix_of
from surrogate.mechanics.solids.elements import gradients_at

AT_ONCE = 256  # samples


class LinearResponse(nn.Module):
    """Grid forces in N to the linear response in m and its gradient, both on the grid.

    Parameters
    ----------
    geometry : Geometry
    material : ShippedMaterial, or tuple of some
    gradient : bool
        Also compute the gradient.
    precision : torch.dtype
        Of K⁻¹.
    on_points : bool
        Whether K is that of elements with all their points; otherwise of linear ones on the nodes.

    Attributes
    ----------
    compliance : Compliance
    gradient_rms : Tensor, ()
        Root mean square of the gradients under the training forces; 1 until `scale_gradient`.
    """

    gradient_rms: Tensor

    def __init__(
        self,
        geometry: Geometry,
        material: Materials,
        gradient: bool = True,
        precision: torch.dtype = torch.float32,
        on_points: bool = False,
    ) -> None:
        super().__init__()
        grid, self.nodes = geometry.grid, len(geometry.coordinates)
        self.shape = grid.shape
        self.compliance: Compliance | BlockSolve = Compliance(
            geometry, material, precision, on_points
        )
        sources = grid.sources.reshape(-1, grid.sources.shape[-1])
        to_grid = matrix_of(sources, grid.source_weights.reshape(sources.shape), self.nodes)
        self.to_grid, self.to_nodes = WeightedSums(to_grid), WeightedSums(to_grid.T.tocsr())
        operators = []
        if gradient:
            operators = nodal_gradient(geometry.coordinates, geometry.cells, geometry.cell_type)
        self._body, self._in_shapes = (geometry, material, on_points), dict[bytes, Tensor]()
        self.derivatives = nn.ModuleList(WeightedSums(o) for o in operators)
        self.register_buffer("gradient_rms", torch.ones(()))

    def _load_from_state_dict(self, state: dict[str, Tensor], prefix: str, *others: object) -> None:
        state.pop(prefix + "compliance", None)  # stored in runs before 0.2
        super()._load_from_state_dict(state, prefix, *others)

    @torch.no_grad()
    def scale_gradient(self, force: Tensor) -> None:
        """Measure the gradients under the forces of the training samples, (N, d, nx, ny[, nz])."""
        total, count = torch.zeros((), dtype=torch.float64), 0
        for batch in torch.split(force, AT_ONCE):
            nodal = self.at_nodes(batch).float()
            gradient = self.fields_on_grid(nodal, self.slopes(nodal))[1]
            total, count = total + gradient.double().square().sum().cpu(), count + gradient.numel()
        rms = (total / count).sqrt()
        self.gradient_rms.copy_(torch.where(rms > 0, rms, torch.ones_like(rms)))

    def forward(self, force: Tensor, response: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Respond to forces.

        Parameters
        ----------
        force : Tensor, (N, d, nx, ny[, nz])
            In N.
        response : Tensor, (N, d, n_nodes), optional
            The linear response at the nodes in m, if it is known.

        Returns
        -------
        displacement : Tensor, (N, d, nx, ny[, nz])
            U_lin in m; zero where the grid has no value.
        gradient : Tensor, (N, d², nx, ny[, nz])
            ∂u_lin,i / ∂x_j over `gradient_rms`, channel i + d j; no channels without `gradient`.
        """
        if torch.compiler.is_exporting():  # loops in a file know nothing of the precision around
            return self.fields(force, response)
        with torch.autocast(force.device.type, enabled=False):
            return self.fields(force, response)

    def fields(self, force: Tensor, response: Tensor | None) -> tuple[Tensor, Tensor]:
        """Return what `forward` does."""
        return self.on_grid(self.at_nodes(force) if response is None else response)

    def at_nodes(self, force: Tensor) -> Tensor:
        """Respond at the nodes, in m: (N, d, nx, ny[, nz]) → (N, d, n_nodes)."""
        response: Tensor = self.compliance(self.to_nodes(force.flatten(2)).mT)
        return response.mT

    @torch.no_grad()
    def in_shapes(self, force: Tensor, parameters: NDArray[np.float64]) -> Tensor:
        """Respond at the nodes, every sample in the shape of its parameters, (N, n_parameters).

        As `at_nodes`. Responses are kept, each of which has a factor of its own.
        """
        geometry, material, on_points = self._body
        nodal = self.to_nodes(force.flatten(2)).mT.cpu().double().numpy()
        found = torch.zeros(nodal.shape).to(force).mT.contiguous()
        for field, f, values in zip(found, nodal, parameters, strict=True):
            key = hashlib.sha256(f.tobytes() + values.tobytes()).digest()
            if key not in self._in_shapes:
                at_points = on_points and geometry.has_points_between
                body = Equilibrium(geometry.shaped(values), material, at_points)
                u = body.linear_response(f[None])[0, : len(f)]
                self._in_shapes[key] = torch.from_numpy(u).to(force).mT
            field.copy_(self._in_shapes[key])
        return found

    def on_grid(self, nodal: Tensor) -> tuple[Tensor, Tensor]:
        """Return what `forward` does, of a response at the nodes: (N, d, n_nodes)."""
        nodal = nodal.float()
        return self.fields_on_grid(nodal, self.slopes(nodal) / self.gradient_rms)

    def slopes(self, nodal: Tensor) -> Tensor:
        """∂u_i / ∂x_j at the nodes, (N, d², n_nodes); no channels without `gradient`."""
        of_axes = [of(nodal) for of in self.derivatives]
        return torch.cat(of_axes, dim=1) if of_axes else nodal[:, :0]

    def fields_on_grid(self, *nodal: Tensor) -> tuple[Tensor, Tensor]:
        """Return the first field on the grid, and all others: (N, channels, n_nodes) each."""
        fields = torch.cat(nodal, dim=1)
        grid = self.to_grid(fields).reshape(*fields.shape[:2], *self.shape)
        first = nodal[0].shape[1]
        return grid[:, :first], grid[:, first:]


def required(material: Materials | None) -> Materials:
    """Return the material; InputError if there is none."""
    if material is None:
        raise InputError("the linear response expects the material of the body, found none")
    return material


Array = NDArray[np.float64]


def nodal_gradient(coordinates: Array, cells: NDArray[np.int64], cell_type: str) -> list[csr_array]:
    """Make the sparse operators of the d derivatives, each (n_nodes, n_nodes).

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
        Node numbers, VTK order.
    cell_type : str
        Meshio's name of the cells.
    """
    corners = np.array(CORNERS[cell_type], dtype=np.float64)
    gradients, _ = gradients_at(coordinates, cells, cell_type, corners)
    nodes = len(coordinates)
    share = 1 / np.maximum(np.bincount(cells.ravel(), minlength=nodes), 1)
    shape = gradients.shape[:-1]
    rows = np.broadcast_to(cells[:, :, None], shape).ravel()
    columns = np.broadcast_to(cells[:, None, :], shape).ravel()
    return [
        coo_array(
            (gradients[..., j].ravel() * share[rows], (rows, columns)), shape=(nodes, nodes)
        ).tocsr()
        for j in range(coordinates.shape[1])
    ]
