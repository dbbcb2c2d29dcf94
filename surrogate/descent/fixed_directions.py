r"""A fixed number of directions of any number of loads, by operations that an exported file knows.

They are those of `surrogate.descent.descent`, with the same P and the same pairs, of bodies of one
Neo-Hookean material and linear elements under dead loads; the moduli in P then cancel. K(0)⁻¹ is
that of the linear response, L⁻¹ is dense. A file has no loops that end early, so that

- every load takes all directions, and begins at its prediction, however far it is off;
- a step is shortened to the largest of `PARTS` that inverts no cell, and once where the force along
  it turns round;
- nothing looks at the softest modes: the file does not know whether a state is stable.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from shared_schema.common.errors import InputError
from surrogate.descent.descent import MOST
from surrogate.descent.directions import CURVED, GROWN, LEAST, PAIRS, TURNED
from surrogate.mechanics.compliance import DENSE
from surrogate.mechanics.linear_response import LinearResponse
from surrogate.mechanics.matrices.band_matrix import BandLayout
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.mechanics.solids.deformation import determinant, stress
from surrogate.mechanics.solids.solid import Solid
from surrogate.mechanics.solids.zones import material_of_zones, weights_of_zones
from surrogate.series.series_response import CellOperators

PARTS = (1.0, 0.5, 0.25, 0.125)  # of a direction
Pair = tuple[Tensor, Tensor, Tensor]


class FixedDirections(nn.Module):
    """A number of directions from predicted displacements.

    Fields are (N, d, n_nodes), in double precision.

    Parameters
    ----------
    equilibrium : Equilibrium
    response : LinearResponse
        Its K(0)⁻¹ is used.
    count : int
        Number of directions.

    Raises
    ------
    InputError
        If the body is another one, or the count is not from 1 to 100.
    """

    free: Tensor
    laplacian: Tensor
    shares: Tensor

    def __init__(self, equilibrium: Equilibrium, response: LinearResponse, count: int) -> None:
        super().__init__()
        material, geometry = material_of_zones(equilibrium.solid.materials), equilibrium.geometry
        require_exportable(equilibrium, count)
        assert material is not None
        self.material, self.response, self.count = material, response, count
        solid = equilibrium.solid
        self.operators = CellOperators(geometry, material, solid.gradients, weights_of_zones(solid))
        self.register_buffer("free", torch.from_numpy(equilibrium.free.T), persistent=False)
        shares = solid.volumes / solid.volumes.sum(1, True)
        self.register_buffer("shares", shares, persistent=False)
        small = len(equilibrium.layout.dofs) <= DENSE
        laplacian = torch.from_numpy(inverse_laplacians(equilibrium))
        precision = torch.float64 if small else torch.float32
        self.register_buffer("laplacian", laplacian.to(precision), persistent=False)

    def forward(self, force: Tensor, predicted: Tensor) -> tuple[Tensor, Tensor]:
        """Go on from predictions.

        Parameters
        ----------
        force, predicted : Tensor, (N, n_nodes, d)
            Dead forces in N and displacements in m.

        Returns
        -------
        displacement : Tensor, (N, n_nodes, d)
            In m, after the last direction.
        estimate : Tensor, (N,)
            Length in m of the last direction at the node that moves most: how wrong the state
            before it was; infinite if this state has inverted cells.
        """
        f = force.double().transpose(1, 2) * self.free
        u = predicted.double().transpose(1, 2) * self.free
        h, pairs = self.operators.gradient(u), list[Pair]()
        r = self._out_of_balance(h, f)
        for number in range(self.count):
            d = -self._recursion(h, r, pairs[-PAIRS:])
            slope = self.operators.gradient(d)
            parts = torch.tensor(PARTS, dtype=h.dtype, device=h.device)[:, None]
            part = (parts * inside(h + wide(parts) * slope)).amax(0)  # 0 if all invert a cell
            if number < self.count - 1:
                work, trial = dot(d, r), self._out_of_balance(h + wide(part) * slope, f)
                after = dot(d, trial)
                less = torch.where(after > -TURNED * work, work / (work - after), 1.0).clamp(LEAST)
                grown = dot(trial, trial) > GROWN**2 * dot(r, r)
                part = part * torch.where(grown, 0.5, less)
                before, h = r, h + wide(part) * slope
                r = self._out_of_balance(h, f)
                pairs.append(self._pair(part[:, None, None] * d, r - before))
            u = u + part[:, None, None] * d
        length = d.square().sum(1).amax(-1).sqrt()
        estimate = torch.where(inside(h), length, torch.inf)
        return u.transpose(1, 2), estimate

    def _pair(self, s: Tensor, y: Tensor) -> Pair:
        """A step, the change of r, and one over its work; 0 if the work is too small."""
        work = dot(s, y)
        kept = work > CURVED * (dot(s, s) * dot(y, y)).sqrt()
        return s, y, torch.where(kept, 1 / work, 0.0)

    def _recursion(self, h: Tensor, r: Tensor, pairs: list[Pair]) -> Tensor:
        """H r by the two loops of L-BFGS."""
        q, shares = r, []
        for s, y, inverse in reversed(pairs):
            shares.append((dot(s, q) * inverse)[:, None, None])
            q = q - shares[-1] * y
        found = self._carried(self._mean_deformation(h), q)
        for (s, y, inverse), share in zip(pairs, reversed(shares), strict=True):
            found = found + (share - (dot(y, found) * inverse)[:, None, None]) * s
        return found

    def _carried(self, f: Tensor, r: Tensor) -> Tensor:
        """T K(0)⁻¹ Tᵀ r."""
        back = self.operators.gradient(self._poisson(r))
        force = self.operators.forces(product(f.transpose(1, 2), back)) * self.free
        slopes = self.operators.gradient(self.response.respond(force))
        return self._poisson(self.operators.forces(product(f, slopes)))

    def _mean_deformation(self, h: Tensor) -> Tensor:
        """F̄ of the cells, at their points: (N, d, d, n_points) → same."""
        of_cells = h.reshape(*h.shape[:3], *self.shares.shape)
        means = (of_cells * self.shares).sum(-1, True).expand_as(of_cells)
        return deformation_gradient(means.reshape(h.shape))

    def _poisson(self, right: Tensor) -> Tensor:
        """L⁻¹ of every component, zero where it is held."""
        rows = right.transpose(0, 1).to(self.laplacian.dtype)
        return (rows @ self.laplacian).transpose(0, 1).to(right.dtype)

    def _out_of_balance(self, h: Tensor, f: Tensor) -> Tensor:
        """Out-of-balance forces r in N, of displacement gradients (N, d, d, n_points)."""
        piola = stress(deformation_gradient(h).permute(1, 2, 0, 3), self.material)
        return self.operators.forces(piola.permute(2, 0, 1, 3)) * self.free - f


def require_exportable(equilibrium: Equilibrium, count: int) -> None:
    """Raise InputError unless a file can hold so many directions of a body."""
    materials, geometry = equilibrium.solid.materials, equilibrium.geometry
    if not 1 <= count <= MOST:
        raise InputError(f"--directions {count}: expected 1 to {MOST}")
    known = material_of_zones(materials) is not None
    known = known and type(equilibrium) is Equilibrium and type(equilibrium.solid) is Solid
    if not known or geometry.pressed is not None:
        raise InputError(
            f"--directions {count}: expected a body of one Neo-Hookean material, or of some "
            "that differ in 'young_modulus' alone, and linear elements, under dead loads"
        )
    nodes = int(equilibrium.free.any(axis=1).sum())
    if nodes > DENSE:
        raise InputError(
            f"--directions {count}: expected a body of at most {DENSE} nodes, found {nodes}"
        )


def inverse_laplacians(equilibrium: Equilibrium) -> np.ndarray:
    """L⁻¹ of every component, (d, n_nodes, n_nodes), zero where it is held; one if all are alike.

    Without the modulus of the first zone, which cancels.
    """
    geometry, solid = equilibrium.geometry, equilibrium.solid
    gradients = solid.gradients
    metric = torch.einsum("cq,cqaj,cqbj->cab", weights_of_zones(solid), gradients, gradients)
    alike, found = np.unique(equilibrium.free, axis=1), []
    for free in (equilibrium.free if alike.shape[1] > 1 else alike).T:
        layout = BandLayout(geometry.coordinates, geometry.cells, ~free[:, None])
        factor = layout.factor(layout.assembled(metric[None])[0])
        assert factor is not None  # a component that is free everywhere makes K(0) singular
        inverse = np.zeros((len(free), len(free)))
        unit = np.eye(len(layout.dofs))
        inverse[np.ix_(layout.dofs, layout.dofs)] = factor.solve(unit)
        found.append(inverse)
    return np.stack(found)


def deformation_gradient(h: Tensor) -> Tensor:
    """F = I + H: (…, d, d, n_points) → same."""
    return h + torch.eye(h.shape[-2], dtype=h.dtype, device=h.device)[:, :, None]


def product(a: Tensor, b: Tensor) -> Tensor:
    """Products of matrices at the points: (N, d, d, n_points) twice → same."""
    return (a[:, :, :, None] * b[:, None]).sum(2)


def inside(h: Tensor) -> Tensor:
    """Whether no cell is inverted: (…, d, d, n_points) → (…)."""
    return (determinant(deformation_gradient(h).movedim((-3, -2), (0, 1))) > 0).all(-1)


def wide(x: Tensor) -> Tensor:
    """(…) → (…, 1, 1, 1)."""
    return x[..., None, None, None]


def dot(a: Tensor, b: Tensor) -> Tensor:
    """Products of fields: (N, d, n_nodes) twice → (N,)."""
    return (a * b).flatten(1).sum(-1)
