r"""A fixed number of directions of any number of loads, by operations that an exported file knows.

They are those of `surrogate.mechanics.descent.descent`, with the same P and the same pairs, of
bodies of linear elements under dead loads. K(0)⁻¹ is that of the linear response, L⁻¹ is dense. A
file has no loops that end early, so that

- every load takes all directions, and begins at its prediction, however far it is off;
- a step is shortened to the largest of `PARTS` that inverts no cell, and once where the force along
  it turns round;
- nothing looks at the softest modes: the file does not know whether a state is stable.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from shared_schema.common.errors import InputError
from surrogate.mechanics.descent.carried_compliance import laplacians, laplacians_of_cells
from surrogate.mechanics.descent.descent import MOST
from surrogate.mechanics.descent.directions import (
    CURVED,
    GROWN,
    LEAST,
    PAIRS,
    TURNED,
    two_loops,
)
from surrogate.mechanics.equilibrium.compliance import DENSE
from surrogate.mechanics.equilibrium.linear_response import LinearResponse
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.solids.deformation import determinant
from surrogate.mechanics.solids.solid import Solid
from surrogate.mechanics.solids.stress_path import StressPath

PARTS = (1.0, 0.5, 0.25, 0.125)  # of a direction
Pair = tuple[Tensor, Tensor, Tensor]


class FixedDirections(nn.Module):
    """A number of directions from predicted displacements.

    Fields are (N, n_nodes, d), in double precision.

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
    moduli: Tensor
    shares: Tensor

    def __init__(self, equilibrium: Equilibrium, response: LinearResponse, count: int) -> None:
        super().__init__()
        require_exportable(equilibrium, count)
        self.response, self.count, self.solid = response, count, equilibrium.solid.apart()
        self.register_buffer("free", torch.from_numpy(equilibrium.free), persistent=False)
        volumes = self.solid.volumes
        shares = volumes / volumes.sum(1, True)
        self.register_buffer("shares", shares[:, None], persistent=False)
        moduli = self.solid.moduli_of_cells()[:, None, None]
        self.register_buffer("moduli", moduli, persistent=False)
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
        f, u = force.double() * self.free, predicted.double() * self.free
        h, pairs = self.solid.slopes(u), list[Pair]()
        r = self._out_of_balance(h, f)
        for number in range(self.count):
            d = -self._recursion(h, r, pairs[-PAIRS:])
            slope = self.solid.slopes(d)
            parts = [part * self._inside(h + part * slope) for part in PARTS]
            part = torch.stack(parts).amax(0)  # 0 if all invert a cell
            if number < self.count - 1:
                work, trial = dot(d, r), self._out_of_balance(h + part[:, None] * slope, f)
                after = dot(d, trial)
                less = torch.where(after > -TURNED * work, work / (work - after), 1.0).clamp(LEAST)
                grown = dot(trial, trial) > GROWN**2 * dot(r, r)
                part = part * torch.where(grown, 0.5, less)
                before, h = r, h + part[:, None] * slope
                r = self._out_of_balance(h, f)
                pairs.append(self._pair(part[:, None, None] * d, r - before))
            u = u + part[:, None, None] * d
        length = d.square().sum(2).amax(1).sqrt()
        return u, torch.where(self._inside(h), length, torch.inf)

    def _pair(self, s: Tensor, y: Tensor) -> Pair:
        """A step, the change of r, and one over its work; 0 if the work is too small."""
        work = dot(s, y)
        kept = work > CURVED * (dot(s, s) * dot(y, y)).sqrt()
        return s, y, torch.where(kept, 1 / work, 0.0)[:, None, None]

    def _recursion(self, h: Tensor, r: Tensor, pairs: list[Pair]) -> Tensor:
        """H r by the two loops of L-BFGS."""
        carried = partial(self._carried, self._mean_deformation(h))
        return two_loops(pairs, r, carried, lambda a, b: dot(a, b)[:, None, None])

    def _carried(self, f: Tensor, r: Tensor) -> Tensor:
        """T K(0)⁻¹ Tᵀ r."""
        back = self.solid.slopes(self._poisson(r))
        force = self._forces(product(f.transpose(0, 1), back)) * self.free
        slopes = self.solid.slopes(self.response.compliance(force))
        return self._poisson(self._forces(product(f, slopes)))

    def _forces(self, stress: Tensor) -> Tensor:
        """Forces of such stresses in units of the shear moduli."""
        return self.solid.forces_of(self.moduli * stress)

    def _mean_deformation(self, h: Tensor) -> Tensor:
        """F̄ of the cells: (d, d, n_cells, N, n_points) → same, with one point."""
        return self.solid.identity + (h * self.shares).sum(-1, True)

    def _poisson(self, right: Tensor) -> Tensor:
        """L⁻¹ of every component, zero where it is held."""
        rows = right.permute(2, 0, 1).to(self.laplacian.dtype)
        return (rows @ self.laplacian).permute(1, 2, 0).to(right.dtype)

    def _out_of_balance(self, h: Tensor, f: Tensor) -> Tensor:
        """Out-of-balance forces r in N, of displacement gradients."""
        path = StressPath(self.solid, (self.solid.identity + h)[:, :, None])
        return self.solid.forces_of(path.stress[:, :, 0]) * self.free - f

    def _inside(self, h: Tensor) -> Tensor:
        """Whether no cell is inverted: (d, d, n_cells, N, n_points) → (N,)."""
        return (determinant(self.solid.identity + h) > 0).all(2).all(0)


def product(a: Tensor, b: Tensor) -> Tensor:
    """Matrix products A B: (d, d, …) twice → same."""
    return (a[:, :, None] * b).sum(1)


def require_exportable(equilibrium: Equilibrium, count: int) -> None:
    """Raise InputError unless a file can hold so many directions of a body."""
    if not 1 <= count <= MOST:
        raise InputError(f"directions {count}: expected 1 to {MOST}", "directions")
    linear = equilibrium.points is None and type(equilibrium.solid) is Solid
    if not linear or equilibrium.geometry.pressed is not None:
        raise InputError(
            f"directions {count}: expected a body of linear elements, under dead loads",
            "directions",
        )
    nodes = int(equilibrium.free.any(axis=1).sum())
    if nodes > DENSE:
        raise InputError(
            f"directions {count}: expected a body of at most {DENSE} nodes, found {nodes}",
            "directions",
        )


def inverse_laplacians(equilibrium: Equilibrium) -> np.ndarray:
    """L⁻¹ of every component, (d, n_nodes, n_nodes), 0 where it is held; one if all are alike."""
    factors = laplacians(equilibrium, laplacians_of_cells(equilibrium))
    nodes, d = equilibrium.free.shape
    inverse = np.zeros((1 if len(factors) == 1 else d, nodes, nodes))
    for dofs, components, factor in factors:
        found = factor.solve(np.eye(len(dofs)))
        for component in components[: len(inverse)]:
            inverse[component][np.ix_(dofs, dofs)] = found
    return inverse


def dot(a: Tensor, b: Tensor) -> Tensor:
    """Products of fields: (N, n_nodes, d) twice → (N,)."""
    return (a * b).flatten(1).sum(-1)
