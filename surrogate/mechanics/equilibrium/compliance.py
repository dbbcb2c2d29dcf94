r"""The compliance of the undeformed body: :math:`u = K^{-1} f` at all points, as PyTorch has it.

K and its factor are those of `surrogate.mechanics.equilibrium.out_of_balance`. A small body has K⁻¹
as a dense matrix, for exported files, a GPU and, up to `BY_MATRIX` degrees of freedom, where it
fits the cache, a CPU; otherwise the factor solves. Columns of K⁻¹ that are met and the responses to
uniform body forces are kept (`surrogate.mechanics.equilibrium.kept_responses`): a load that is made
of them costs a sum. Forces in single precision are solved for by a factor in single precision,
unless the body is so slender that this has an effect.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from shared_schema.common.bodies.distributed_loads import nodal_volumes
from shared_schema.materials import Materials
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.block_solve import BlockSolve, at_dofs
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.kept_responses import KeptResponses
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.matrices.factors import CLOSE, band_order
from surrogate.mechanics.solids.mixed_elements import TaylorHoodSolid

DENSE = 4000  # degrees of freedom; K⁻¹ takes 64 MB
BY_MATRIX = 1000  # degrees of freedom up to which a CPU responds by K⁻¹
LEAST_BLOCK = 1024  # rows of a block on a GPU: products of smaller ones are launches
ROOM = 0.7  # of the memory of a GPU that is free: most that the blocks may take
NOTHING = 1e-12  # of the largest force of a unit load: what is zero but for rounding
FEW = 16  # samples whose loads are answered by columns that are not there yet


class Compliance(nn.Module):
    """Forces in N to displacements in m: (N, n_points, d) → same.

    Components that are held stay zero, and forces on them have no effect. K⁻¹ is symmetric, so that
    gradients with respect to forces are solves too.

    Parameters
    ----------
    geometry : Geometry
    material : ShippedMaterial, or tuple of some
    precision : torch.dtype
        Of the dense matrix.
    on_points : bool
        Whether elements have all their points; otherwise they are linear ones on the nodes.

    Attributes
    ----------
    equilibrium : Equilibrium
        Layout and factor of K are its own.
    dofs : Tensor of int, (n,)
        Degrees of freedom, point · d + component: those of one component after the other.
    is_small : bool
        Whether there may be a dense K⁻¹.
    matrix : Tensor, (n, n)
        K⁻¹ in m/N; empty for a large body, and until `make_dense`.
    kept : KeptResponses
    """

    dofs: Tensor
    matrix: Tensor

    def __init__(
        self,
        geometry: Geometry,
        material: Materials,
        precision: torch.dtype = torch.float32,
        on_points: bool = False,
    ) -> None:
        super().__init__()
        between = on_points and geometry.has_points_between
        self.equilibrium = Equilibrium(geometry, material, between)
        of_case, geometry = geometry, self.equilibrium.geometry
        size = self.equilibrium.free.size
        component, point = np.nonzero(self.equilibrium.free.T)
        dofs = point * geometry.dimension + component
        self.is_small = 0 < len(dofs) <= DENSE
        self.register_buffer("dofs", torch.from_numpy(dofs), persistent=False)
        self.register_buffer("matrix", torch.empty(0, dtype=precision), persistent=False)
        if len(dofs) <= BY_MATRIX:
            self.make_dense()
        self._blocks: dict[torch.device, BlockSolve | None] = {}
        weight, units = nodal_volumes(geometry.coordinates, geometry.cells)[:, None], []
        pressed = FollowingLoads.of(of_case, np.eye(len(of_case.following)))
        pressures = pressed.at_rest if between else pressed.load[:, : self.equilibrium.nodes]
        for load in [*(weight * axis for axis in np.eye(geometry.dimension)), *pressures]:
            flat = (load * self.equilibrium.free[: len(load)]).ravel()
            acting = np.flatnonzero(np.abs(flat) > NOTHING * np.abs(flat).max(initial=0.0))
            units.append((acting, flat[acting]))
        self.kept = KeptResponses(self._solved, size, units)

    def make_dense(self) -> None:
        """Compute the dense K⁻¹ of a small body, unless it is there."""
        if self.is_small and not len(self.matrix):
            dofs = self.dofs.cpu().numpy()
            inverse = self.solve(np.eye(self.equilibrium.free.size)[dofs])[:, dofs]
            self.matrix = torch.from_numpy(inverse).to(self.matrix)

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> Self:
        if fn(torch.empty(0)).device.type != "cpu":
            self.make_dense()
        return super()._apply(fn, recurse)  # type: ignore[no-untyped-call]

    def forward(self, force: Tensor) -> Tensor:
        """Respond to forces in N by displacements in m: (N, n_points, d) → same."""
        precise = force.to(self.matrix.dtype) if self.is_small else force
        elsewhere = torch.compiler.is_compiling() or force.device.type != "cpu"
        if len(self.matrix) and (elsewhere or self._by_matrix):
            found = at_dofs(precise, self.dofs, lambda f: functional.linear(f, self.matrix))
        else:
            found = _Response.apply(precise, self)  # type: ignore[no-untyped-call]
        return found.to(force.dtype)

    def blocks_on(self, device: torch.device) -> BlockSolve | None:
        """What solves on a GPU, made at its first use; None on a CPU, and where it has no room."""
        if device.type != "cuda":
            return None
        if device not in self._blocks:
            self._blocks[device] = block_solve(self.equilibrium, device)
        return self._blocks[device]

    def is_on(self, device: torch.device) -> bool:
        """Whether responses are computed on a device."""
        return self.is_small or self.blocks_on(device) is not None

    def inputs_at(self, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Degrees of freedom that are not held, of some nodes: component by component."""
        free = self.equilibrium.free
        inputs = (nodes[:, None] * free.shape[1] + np.arange(free.shape[1])).T.ravel()
        return np.asarray(inputs[free.ravel()[inputs]])

    def respond(self, force: NDArray[Any], new: bool = True) -> NDArray[Any]:
        """Respond by sums of what is kept, or else, or in double, by solves: as `forward`.

        Loads on a few nodes are solved for once where there may be `new` columns.
        """
        free = self.equilibrium.free
        flat = (force * free).reshape(len(force), free.size)
        is_single = force.dtype == np.float32
        found = self.kept.answers(flat, new) if is_single else self._solved(flat)
        return found.reshape(force.shape)

    def solve(self, force: NDArray[Any]) -> NDArray[Any]:
        """Solve with the factor, in the precision of the forces: (N, n_points · d) → same."""
        shape = len(force), *self.equilibrium.free.shape
        return self.equilibrium.linear_response(force.reshape(shape)).reshape(force.shape)

    def _solved(self, force: NDArray[Any]) -> NDArray[Any]:
        """Respond by the dense matrix, or solves: (N, n_points · d) → same."""
        if not self._by_matrix:
            return self.solve(force)
        dofs, found = self.dofs.numpy(), np.zeros_like(force)
        found[:, dofs] = force[:, dofs] @ self.matrix.numpy()
        return found

    @property
    def _by_matrix(self) -> bool:
        """Whether a CPU responds by K⁻¹."""
        return len(self.matrix) > 0 and len(self.dofs) <= BY_MATRIX


@torch.inference_mode(False)
@torch.no_grad()
def block_solve(equilibrium: Equilibrium, device: torch.device) -> BlockSolve | None:
    """What solves with K(0) on a device; None if it has no room, or K is not formed."""
    if isinstance(equilibrium.solid, TaylorHoodSolid):
        return None
    geometry = equilibrium.geometry
    dofs, width = band_order(geometry.coordinates, geometry.cells, geometry.held)
    if device.type == "cuda":
        room = ROOM * torch.cuda.mem_get_info(device)[0]  # bytes
        if 4 * len(dofs) * width + 6 * 8 * width**2 > room:
            return None
    return BlockSolve(equilibrium, device, CLOSE, LEAST_BLOCK)


class _Response(torch.autograd.Function):
    """The response of a large body; its derivative is the response to gradients.

    That is a solve, since gradients act on all nodes, and can be differentiated again.
    """

    @staticmethod
    def forward(ctx: Any, force: Tensor, compliance: Compliance, by_columns: bool = True) -> Tensor:
        ctx.compliance = compliance
        blocks = compliance.blocks_on(force.device)
        if blocks is not None:
            return blocks(force)
        forces = force.cpu().numpy()
        if by_columns:
            found = compliance.respond(forces, new=len(force) <= FEW)
        else:
            found = compliance.equilibrium.linear_response(forces)
        return torch.from_numpy(found).to(force)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        found = _Response.apply(gradients[0], ctx.compliance, False)  # type: ignore[no-untyped-call]
        return found, None, None
