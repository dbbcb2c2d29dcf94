r"""A solid of finite elements: strain energy, internal forces, tangent, for any material.

With the displacements u at the nodes, the shape functions' gradients :math:`G_a = ∇N_a` and the
quadrature volumes :math:`w_q`,

.. math::
    F = I + \sum_a u_a ⊗ G_a, \qquad E(u) = \sum_q w_q W(F_q), \qquad
    f_{int,a} = \frac{∂E}{∂u_a} = \sum_q w_q P_q G_a, \qquad
    K_{aibk} = \sum_q w_q G_{aj} \mathbb{A}_{ijkl} G_{bl}

with the stress P of `surrogate.mechanics.solids.deformation`. Tangents are those of compiled loops
(`surrogate.mechanics.compiled.solid`). The same equations, in
UFL, are those of `datagen`; a test compares the two.

*Incompressible* elements have a dilation θ of their own in place of J, so that they do not lock
where the material hardly changes its volume: the projection of J on some functions, in the mean
square over the body (Simo, Taylor and Pister 1985),

.. math::
    E(u) = \sum_q w_q W(\bar F_q), \quad \bar F = (θ / J)^{1/d} F, \quad θ = Π J, \qquad
    P = \frac{∂W}{∂F} + p \, \mathrm{cof} F, \quad p = Π \frac{∂W}{∂θ}.

These functions are constant in every cell, or linear in it and continuous
(`surrogate.mechanics.solids.mixed_elements`). A displacement that is slightly wrong has pressures p
that are very wrong, since a small change of the volume makes a large one. The tangent without them
is called relaxed; a step with it makes the volumes right.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from torch import Tensor, nn

from shared_schema.materials import Materials, as_tuple
from surrogate.mechanics.energy.law import Law, law_of
from surrogate.mechanics.energy.recording import Recording
from surrogate.mechanics.matrices.sparse_products import SparseProduct
from surrogate.mechanics.solids.deformation import recorded_law
from surrogate.mechanics.solids.elements import cell_gradients
from surrogate.mechanics.solids.stress_path import StressPath

if TYPE_CHECKING:
    from surrogate.mechanics.compiled.solid import CompiledSolid


class Solid(nn.Module):
    """Energy and forces of a body, for N displacement fields at once.

    Its tensors are in double precision on the CPU; ``.to(device, dtype)`` moves them.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
        Node numbers, VTK order.
    cell_type : str
        Meshio's name of the cells.
    material : ShippedMaterial, or tuple of some
    parts : array of int, (n_cells,), optional
        Position of each cell's material in the tuple.
    fibres : array, (n_cells, families, d), optional
        Unit directions of fibres, which materials with some need.

    Attributes
    ----------
    nodes : int
        Number of nodes.
    projects : bool
        Whether θ is found from J.
    shapes : Tensor, (n_points, n_functions)
        Values of the functions of a cell that Π leads to.
    corners : Tensor of int, (n_cells, n_functions)
        Their numbers.
    """

    cells: Tensor
    gradients: Tensor
    volumes: Tensor
    fibres: Tensor | None
    shapes: Tensor
    corners: Tensor
    _order: Tensor
    projects = False

    def __init__(
        self,
        coordinates: NDArray[np.float64],
        cells: NDArray[np.int64],
        cell_type: str,
        material: Materials,
        parts: NDArray[np.int64] | None = None,
        fibres: NDArray[np.float64] | None = None,
    ) -> None:
        super().__init__()
        gradients, volumes = cell_gradients(coordinates, cells, cell_type)
        self.nodes = len(coordinates)
        self.materials = as_tuple(material)
        if len(self.materials) > 1:
            if parts is None or not np.all((parts >= 0) & (parts < len(self.materials))):
                raise ValueError("a cell is of none of the materials")
            order = torch.from_numpy(np.argsort(parts, kind="stable"))
            self.register_buffer("_order", order.argsort(), persistent=False)
            for i in range(len(self.materials)):
                members = torch.from_numpy(np.flatnonzero(parts == i))
                self.register_buffer(f"_members_{i}", members, persistent=False)
        families = max(material.family_count for material in self.materials)
        if families > (0 if fibres is None else fibres.shape[1]):
            raise ValueError("a material has fibres, whose directions are missing")
        directions = None
        if fibres is not None and families:
            directions = torch.tensor(fibres).permute(1, 2, 0)[..., None, None].contiguous()
        self.register_buffer("fibres", directions, persistent=False)
        self.register_buffer("cells", torch.tensor(cells), persistent=False)
        self.register_buffer("gradients", torch.from_numpy(gradients), persistent=False)
        self.register_buffer("volumes", torch.from_numpy(volumes), persistent=False)
        shapes, corners = self._functions(cells, cell_type)
        self.register_buffer("shapes", torch.tensor(shapes), persistent=False)
        self.register_buffer("corners", torch.tensor(corners), persistent=False)
        shape, places = (self.nodes, cells.size), np.arange(cells.size)
        incidence = csr_array((np.ones(cells.size), (cells.ravel(), places)), shape)
        self.sums = SparseProduct(incidence, self.gradients.dtype)

    def _functions(
        self, cells: NDArray[np.int64], cell_type: str
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """`shapes` and `corners`: none."""
        return np.empty((self.volumes.shape[1], 0)), cells[:, :0]

    @property
    def members(self) -> list[Tensor]:
        """Cells of every material, if there are several."""
        count = len(self.materials)
        return [self.get_buffer(f"_members_{i}") for i in range(count)] if count > 1 else []

    def apart(self) -> Self:
        """The same solid, whose tensors go to a device or another precision by themselves."""
        found: Self = _with_own_buffers(self)
        return found

    @cached_property
    def laws(self) -> list[Law]:
        """Law of every material."""
        d = self.gradients.shape[3]
        return [law_of(material, d, self.projects) for material in self.materials]

    @property
    def recorded_laws(self) -> list[tuple[Recording, dict[str, Any]]]:
        """The same as recordings, with their outputs."""
        d = self.gradients.shape[3]
        return [recorded_law(law, d, self.projects) for law in self.laws]

    def deformation_gradient(self, u: Tensor) -> Tensor:
        """F at the quadrature points: (N, n_nodes, d) in m → (d, d, n_cells, N, n_points)."""
        return self.slopes(u) + self.identity

    @property
    def identity(self) -> Tensor:
        """F of the undeformed body: (d, d, 1, 1, 1)."""
        gradients = self.gradients
        unit = torch.eye(gradients.shape[3], dtype=gradients.dtype, device=gradients.device)
        return unit[:, :, None, None, None]

    def slopes(self, u: Tensor) -> Tensor:
        """∇u at the quadrature points: (N, n_nodes, d) in m → (d, d, n_cells, N, n_points)."""
        count, points, corners, d = self.gradients.shape
        rows = u.transpose(0, 1).flatten(1)  # whole rows are fast to select
        at_corners = rows.index_select(0, self.cells.flatten()).reshape(count, corners, -1)
        of_shapes = self.gradients.transpose(1, 2).reshape(count, corners, points * d)
        h = torch.bmm(at_corners.transpose(1, 2), of_shapes).reshape(count, -1, d, points, d)
        return h.permute(2, 4, 0, 1, 3).contiguous()

    def sum_at_nodes(self, forces: Tensor) -> Tensor:
        """Sum what acts at the corners: (n_cells, N, d, n_corners) → (N, n_nodes, d).

        Every node sums what its cells have. ONNX Runtime would scatter what the cells have to the
        nodes on several threads, and lose some of it (its issue 18048).
        """
        count, samples, d, corners = forces.shape
        rows = forces.permute(0, 3, 1, 2).reshape(count * corners, samples * d)
        total: Tensor = self.sums(rows)
        return total.reshape(len(total), samples, d).transpose(0, 1)

    def joined(self, parts: Sequence[Tensor]) -> Tensor:
        """Fields of the cells of all materials, one after the other, as one of all cells."""
        if len(parts) == 1:
            return parts[0]
        return torch.cat(list(parts), dim=-3).index_select(-3, self._order)

    def material_of_cells(self) -> Tensor:
        """Position of each cell's material, (n_cells,)."""
        numbers = torch.zeros(len(self.cells), dtype=torch.int64)
        for number, members in enumerate(self.members):
            numbers[members] = number
        return numbers

    def moduli_of_cells(self) -> Tensor:
        """Shear modulus of every cell at rest in Pa, (n_cells,)."""
        moduli = torch.tensor([each.lame_mu for each in self.materials], dtype=torch.float64)
        return moduli[self.material_of_cells()]

    @cached_property
    def compiled(self) -> CompiledSolid:
        """The same in compiled loops, in double precision on the CPU."""
        from surrogate.mechanics.compiled.solid import CompiledSolid  # Numba: half a second

        return CompiledSolid(copy(self))  # they do not refer to each other

    def projected(self, values: Tensor) -> Tensor:
        """Π of values at the points: (n_cells, N, n_points) → same."""
        raise NotImplementedError("the elements have no dilation of their own")

    def solved_mass(self, sums: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solve with the mass matrix of the functions that Π leads to: (n_functions, …) → same."""
        raise NotImplementedError("the elements have no dilation of their own")

    def composed(
        self, first: Tensor, by_dilation: Tensor, by_pressure: Tensor, square: Tensor
    ) -> Tensor:
        """Tangent of cells from its parts, those at fixed θ and p first.

        Parameters
        ----------
        first : Tensor, (N, n_cells, n_corners d, n_corners d)
        by_dilation, by_pressure : Tensor, (N, n_cells, n_corners d, n_functions)
            Works of ∂²W/∂F∂θ and of cof F, times the functions of a cell.
        square : Tensor, (N, n_cells, n_functions, n_functions)
            Sums of ∂²W/∂θ², times two functions.
        """
        raise NotImplementedError("the elements have no dilation of their own")

    def inverted(self, u: Tensor) -> Tensor:
        """Number of cells with J ≤ 0, or θ ≤ 0, (or no number) at a point: (N, n_nodes, d) → (N,).

        Displacements are in m.
        """
        return (~self.path(u).inside).any(-1).sum(1)[0]

    def energy(self, u: Tensor) -> Tensor:
        """Strain energy E(u) in J, +∞ if a cell is inverted: (N, n_nodes, d) in m → (N,)."""
        path = self.path(u)
        density = torch.where(path.inside & torch.isfinite(path.energy), path.energy, torch.inf)
        return (self.volumes[:, None] * density).sum((1, 3))[0]

    def internal_forces(self, u: Tensor) -> Tensor:
        """f_int = ∂E/∂u in N, no meaning if a cell is inverted: (N, n_nodes, d) in m → same."""
        return self.forces_of(self.path(u).stress[:, :, 0])

    def path(self, u: Tensor) -> StressPath:
        """Stresses from displacements on: (N, n_nodes, d) in m."""
        return StressPath(self, self.deformation_gradient(u)[:, :, None])

    def forces_of(self, stress: Tensor) -> Tensor:
        """Σ_q w_q P_q G_a in N: (d, d, n_cells, N, n_points) in Pa → (N, n_nodes, d)."""
        return self.sum_at_nodes(self.of_cells(stress))

    def of_cells(self, stress: Tensor) -> Tensor:
        """The forces of each cell: (d, d, n_cells, N, n_points) → (n_cells, N, d, n_corners)."""
        count, points, corners, d = self.gradients.shape
        samples = stress.shape[3]
        p = (self.volumes[:, None] * stress).permute(2, 3, 0, 4, 1)
        slopes = self.gradients.transpose(2, 3).reshape(count, points * d, corners)
        forces = torch.bmm(p.reshape(count, samples * d, points * d), slopes)
        return forces.reshape(count, samples, d, corners)

    def stiffness_at_rest(self) -> Tensor:
        """Positive definite stiffness K(0) of every cell in N/m, of the shape of its tangent.

        At rest 𝔸 is the same at all points of a cell; nothing has to be compiled for it.
        """
        count, _, corners, d = self.gradients.shape
        if self.projects:
            return self.compiled.cell_tangents(np.zeros((1, self.nodes, d)))
        units = torch.eye(d * d, dtype=self.gradients.dtype).reshape(d, d, d * d, 1, 1, 1)
        moduli = StressPath(self).along(units.expand(-1, -1, -1, count, -1, -1))
        moduli = moduli.reshape(d, d, d, d, count).permute(4, 0, 1, 2, 3)
        g, volumes = self.gradients, self.volumes
        stress = torch.einsum("cijkl,cqbl->cqijbk", moduli, g)
        found = torch.einsum("cq,cqaj,cqijbk->caibk", volumes, g, stress)
        return found.reshape(1, count, corners * d, corners * d)


def _with_own_buffers(module: nn.Module) -> Any:
    found = copy(module)
    found._buffers = dict(module._buffers)
    modules = ((name, each) for name, each in module._modules.items() if each is not None)
    found._modules = {name: _with_own_buffers(each) for name, each in modules}
    return found
