r"""The compliance of the undeformed body: :math:`u = K^{-1} f` at the nodes that can move.

K and its factor are those of `surrogate.mechanics.equilibrium.out_of_balance`. A small body keeps
K⁻¹ as a dense matrix, for exported files, a GPU and, up to `BY_MATRIX` degrees of freedom, where it
fits the cache, a CPU; otherwise the factor solves. Columns of K⁻¹ that are met and the responses to
uniform body forces are kept (`surrogate.mechanics.equilibrium.kept_responses`): a load that is made
of them costs a sum. Forces in single precision are solved for by a factor in single precision,
unless the body is so slender that this has an effect.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from torch import Tensor, nn
from torch.nn import functional

from shared_schema.common.bodies.cell_volumes import nodal_volumes
from shared_schema.materials import Materials
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.block_solve import BlockSolve
from surrogate.mechanics.equilibrium.kept_responses import KeptResponses
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.matrices.factors import SymmetricFactor
from surrogate.mechanics.matrices.orders import band_order
from surrogate.mechanics.solids.taylor_hood import TaylorHoodSolid

DENSE = 4000  # degrees of freedom; K⁻¹ takes 64 MB
BY_MATRIX = 1000  # degrees of freedom up to which a CPU responds by K⁻¹
CLOSE = 1e-5  # relative error that a factor in single precision may have
LEAST_BLOCK = 1024  # rows of a block on a GPU: products of smaller ones are launches
ROOM = 0.7  # of the memory of a GPU that is free: most that the blocks may take
FEW = 16  # samples whose loads are answered by columns that are not there yet


class Compliance(nn.Module):
    """Forces on the free nodes in N to their displacements in m.

    Degrees of freedom are numbered component by component: component · n_free + node. Single
    components that are held stay zero, and forces on them have no effect. K⁻¹ is symmetric, so that
    gradients with respect to forces are solves too.

    Parameters
    ----------
    geometry : Geometry
    material : ShippedMaterial, or tuple of some
    precision : torch.dtype
        Of the dense matrix.
    on_points : bool
        Whether elements have all their points, which then stand for the nodes; otherwise they are
        linear ones on the nodes.

    Attributes
    ----------
    equilibrium : Equilibrium
        Layout and factor of K are its own.
    free_nodes : Tensor of int, (n_free,)
        Nodes that can move.
    matrix : Tensor, (d · n_free, d · n_free)
        K⁻¹ in m/N; empty for a large body.
    size : int
        d · n_free.
    order : array of int, (n_dofs,)
        Degrees of freedom that are not held, in the order of the factor.
    kept : KeptResponses
    """

    free_nodes: Tensor
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
        geometry = self.equilibrium.geometry
        free = np.flatnonzero(~geometry.clamped)
        self.size = len(free) * geometry.dimension
        axes = np.arange(geometry.dimension)[:, None]
        self._at_nodes = (free * geometry.dimension + axes).ravel()  # places in nodal fields
        self._of_nodes = np.full(geometry.coordinates.shape, self.size)
        self._of_nodes.ravel()[self._at_nodes] = np.arange(self.size)
        self.order = self.by_component(self.equilibrium.layout.dofs)
        self.register_buffer("free_nodes", torch.from_numpy(free), persistent=False)
        matrix = torch.empty(0)
        if self.size <= DENSE:
            matrix = torch.from_numpy(self.solve(np.eye(self.size))).to(precision)
        self.register_buffer("matrix", matrix, persistent=False)
        self._blocks: dict[torch.device, BlockSolve | None] = {}
        volumes = nodal_volumes(geometry.coordinates, geometry.cells)[free]
        by_axis = np.arange(self.size).reshape(geometry.dimension, -1)
        units = [(inputs, volumes) for inputs in by_axis]
        self.kept = KeptResponses(self._solved, self.size, units)

    def forward(self, force: Tensor) -> Tensor:
        """Respond to forces in N by displacements in m: (N, d · n_free) → same."""
        precise = force.to(self.matrix.dtype) if len(self.matrix) else force
        elsewhere = torch.compiler.is_compiling() or force.device.type != "cpu"
        if len(self.matrix) and (elsewhere or self._by_matrix):
            return functional.linear(precise, self.matrix).to(force.dtype)
        found: Tensor = _Response.apply(precise, self)  # type: ignore[no-untyped-call]
        return found.to(force.dtype)

    @cached_property
    def factor(self) -> SymmetricFactor | None:
        """Factor of K, made at its first use; None of a small body."""
        return None if len(self.matrix) else self.equilibrium.undeformed

    def blocks_on(self, device: torch.device) -> BlockSolve | None:
        """What solves on a GPU, made at its first use; None on a CPU, and where it has no room."""
        if device.type != "cuda":
            return None
        if device not in self._blocks:
            self._blocks[device] = block_solve(self, device)
        return self._blocks[device]

    def is_on(self, device: torch.device) -> bool:
        """Whether responses are computed on a device."""
        return len(self.matrix) > 0 or self.blocks_on(device) is not None

    @cached_property
    def quick(self) -> SymmetricFactor:
        """Factor of K for forces in single precision."""
        return in_single_precision(self.equilibrium.undeformed, len(self.order))

    def stiffness(self, dofs: NDArray[np.int64]) -> csr_array:
        """K in N/m, (n_dofs, n_dofs), in some order of its degrees of freedom."""
        equilibrium, layout = self.equilibrium, self.equilibrium.layout
        rows = np.zeros(equilibrium.free.size, np.int64)
        rows[layout.dofs] = np.arange(len(layout.dofs))
        tangent = layout.assembled(equilibrium.solid.stiffness_at_rest())[0]
        return csr_array(layout.matrix(tangent)[rows[dofs]][:, rows[dofs]])

    def by_component(self, dofs: NDArray[np.int64]) -> NDArray[np.int64]:
        """Numbers here of degrees of freedom that are not held, node · d + component."""
        return np.asarray(self._of_nodes.ravel()[dofs])

    def solve(self, force: NDArray[Any]) -> NDArray[Any]:
        """Solve with the factor, in the precision of the forces: (N, d · n_free) → same."""
        is_double = force.dtype == np.float64
        factor = self.equilibrium.undeformed if is_double else self.quick
        found = np.zeros_like(force)
        found[:, self.order] = factor.solve(force[:, self.order].T).T
        return found

    def respond(self, force: NDArray[Any]) -> NDArray[Any]:
        """Respond by sums of what is kept, or else, or in double, by solves: (N, size) → same.

        Loads on a few nodes are solved for once, unless there are many of them.
        """
        if force.dtype == np.float64:
            return self.solve(force)
        return self._summed(force, len(force) <= FEW)

    def inputs_at(self, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Degrees of freedom of the nodes that can move, of some nodes of the mesh."""
        inputs = self._of_nodes[nodes].T.ravel()
        return np.asarray(inputs[inputs < self.size])

    def respond_at_nodes(self, force: NDArray[Any]) -> NDArray[Any]:
        """Respond to forces, given and answered at all nodes: (N, n_nodes, d) → same.

        In single precision loads on a few nodes are answered by columns, however many loads.
        """
        by_component = force.reshape(len(force), -1).take(self._at_nodes, axis=1)
        padded = np.zeros((len(force), self.size + 1), force.dtype)
        single = force.dtype == np.float32
        padded[:, :-1] = self._summed(by_component) if single else self._solved(by_component)
        return padded.take(self._of_nodes, axis=1)

    def _summed(self, force: NDArray[np.float32], new: bool = True) -> NDArray[np.float32]:
        """Respond by sums of what is kept, new columns among it if they may be, or by solves."""
        found, left = np.empty_like(force), []
        for number, load in enumerate(force):
            answer = self.kept.answer(load, new)
            if answer is None:
                left.append(number)
            else:
                found[number] = answer
        if left:
            found[left] = self._solved(force[left])
        return found

    def _solved(self, force: NDArray[Any]) -> NDArray[Any]:
        """Respond by the dense matrix, or solves."""
        return force @ self.matrix.numpy() if self._by_matrix else self.solve(force)

    @property
    def _by_matrix(self) -> bool:
        """Whether a CPU responds by K⁻¹."""
        return len(self.matrix) > 0 and self.size <= BY_MATRIX


@torch.inference_mode(False)
@torch.no_grad()
def block_solve(compliance: Compliance, device: torch.device) -> BlockSolve | None:
    """What solves with K(0) on a device; None if it has no room, or K is not formed."""
    equilibrium = compliance.equilibrium
    if isinstance(equilibrium.solid, TaylorHoodSolid):
        return None
    geometry = equilibrium.geometry
    dofs, width = band_order(geometry.coordinates, geometry.cells, geometry.held)
    if device.type == "cuda":
        room = ROOM * torch.cuda.mem_get_info(device)[0]  # bytes
        if 4 * len(dofs) * width + 6 * 8 * width**2 > room:
            return None
    return BlockSolve(compliance, device, CLOSE, LEAST_BLOCK)


def in_single_precision(factor: SymmetricFactor, size: int) -> SymmetricFactor:
    """The factor in single precision, or itself if a random load tells the difference."""
    force = np.random.default_rng(0).normal(size=size)
    expected = factor.solve(force)
    difference = factor.single.solve(force.astype(np.float32)) - expected
    is_close = np.linalg.norm(difference) <= CLOSE * np.linalg.norm(expected)
    return factor.single if is_close else factor


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
        respond = compliance.respond if by_columns else compliance.solve
        return torch.from_numpy(respond(force.cpu().numpy())).to(force)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        found = _Response.apply(gradients[0], ctx.compliance, False)  # type: ignore[no-untyped-call]
        return found, None, None
