r"""The load series of any body: displacements as combinations of the terms of a power series.

Under s times a load, dead forces f and others that follow the body,

.. math::
    u(s) = \sum_k s^k u_k, \qquad K u_1 = f + f_{p,1}, \qquad
    K u_k = f_{p,k} - \sum_q w_q \, \hat P_{k,q} G_a

with the stiffness K of the undeformed body, the part P̂ₖ of the k-th term of the stress that
follows from those before (`surrogate.mechanics.solids.stress_path`), and the terms of the
following forces (`surrogate.mechanics.series.following_terms`). The prediction is the combination
:math:`\sum_k c_k u_k` that is nearest to equilibrium (`surrogate.mechanics.series.weights`).

Terms are in double precision, on any device, with gradients, and in exported files. On a CPU
without gradients, compiled loops do the same under dead forces, several times faster.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.series.following_terms import FollowingTerms
from surrogate.mechanics.series.weights import Weights
from surrogate.mechanics.solids.stress_path import StressPath

if TYPE_CHECKING:
    from surrogate.mechanics.series.compiled_series import CompiledSeries

Array = NDArray[np.float64]
AT_ONCE = 2**19  # values of the displacement gradients that are held at once: in the cache
AT_ONCE_ON_GPU = 2**26
SMALL = 1e-5  # gradients whose sum of terms, all weights 1, is right to rounding


class BodySeries(nn.Module):
    """Load series of one body; its fields are (N, n_points, d).

    Parameters
    ----------
    equilibrium : Equilibrium
        Its elements and materials are used; displacements and forces are of all its points.
    order : int
        Order n.
    respond : callable, optional
        K⁻¹ of forces in N to displacements in m, of Tensors; that of the equilibrium, which has no
        gradients, by default.
    respond_to_arrays : callable, optional
        The same of arrays, in their precision.
    precision : torch.dtype
        Of compiled loops on a large body.

    Attributes
    ----------
    compiled : bool
        Whether compiled code computes what it knows; others may set it.
    """

    def __init__(
        self,
        equilibrium: Equilibrium,
        order: int,
        respond: Callable[[Tensor], Tensor] | None = None,
        respond_to_arrays: Callable[[Any], Any] | None = None,
        precision: torch.dtype = torch.float64,
    ) -> None:
        super().__init__()
        self.equilibrium, self.order, self.compiled = equilibrium, order, True
        self.solid = equilibrium.solid.apart()
        self._respond = respond
        self._respond_to_arrays = respond_to_arrays or equilibrium.linear_response
        self._precision = np.float64 if precision == torch.float64 else np.float32
        self._weights = Weights(self.solid)
        self._values = order * self.solid.volumes.numel() * self.solid.gradients.shape[3] ** 2

    @cached_property
    def is_compiled(self) -> bool:
        """Whether compiled code knows the body's elements and materials."""
        return not self.solid.projects

    @cached_property
    def loops(self) -> CompiledSeries:
        """The series in compiled loops, of u₁."""
        from surrogate.mechanics.series.compiled_series import (
            CompiledSeries,  # Numba: half a second
        )

        solid = self.equilibrium.solid
        return CompiledSeries(solid, self._precision, self._respond_to_arrays, self.order)

    @cached_property
    def _of_forces(self) -> Callable[[Array], tuple[Array, Array]]:
        """The series in compiled loops, of dead forces."""
        from surrogate.mechanics.series.small_series import SmallSeries

        body, size = self.equilibrium, self.equilibrium.free.size
        if not SmallSeries.fits(body.solid, size):
            return self.loops.of_forces
        units = np.eye(size).reshape(size, *body.free.shape)
        return SmallSeries(body.solid, body.linear_response(units).reshape(size, size), self.order)

    @torch.no_grad()
    def predicted(
        self, forces: Array, following: FollowingLoads | None = None
    ) -> tuple[Array, Array]:
        """Predict displacements of arrays, and tell how much the last term changes them.

        Parameters
        ----------
        forces : array, (N, n_points, d)
            Dead ones in N.
        following : FollowingLoads, optional
            Those of the N load cases.

        Returns
        -------
        displacements : array, (N, n_points, d)
            In m.
        last : array, (N,)
            Largest displacement of a point in the last term in m.
        """
        device = self.solid.volumes.device
        units, amplitudes = FollowingTerms.of(following, device)
        if units is None and self.compiled and self.is_compiled and device.type == "cpu":
            return self._of_forces(forces)
        first = self.first(torch.from_numpy(forces).to(device), units, amplitudes)
        beyond, last = self(first, units, amplitudes)
        return (first + beyond).cpu().numpy(), last.norm(dim=2).amax(1).cpu().numpy()

    def first(
        self, forces: Tensor, units: FollowingTerms | None = None, amplitudes: Tensor | None = None
    ) -> Tensor:
        """u₁ in m, of dead forces in N and following loads as of a call."""
        if units is not None and amplitudes is not None:
            forces = forces + units.term(amplitudes, [])
        return self._response(forces)

    def forward(
        self,
        first: Tensor,
        units: FollowingTerms | None = None,
        amplitudes: Tensor | None = None,
    ) -> tuple[Tensor, Tensor]:
        """Response beyond u₁, and its last term cₙ uₙ, of u₁: in m.

        Parameters
        ----------
        first : Tensor, (N, n_points, d)
            Response to all forces on the undeformed body.
        units : FollowingTerms, optional
            Loads that follow the body.
        amplitudes : Tensor, (N, n), optional
            Theirs in Pa or N.
        """
        if torch.compiler.is_compiling():  # of an exported file
            return self._beyond(first, units, amplitudes)
        tracked = torch.is_grad_enabled() and first.requires_grad
        by_loops = self.compiled and self.is_compiled and first.device.type == "cpu"
        if by_loops and amplitudes is None and not tracked:
            of_loops = self.loops(np.asarray(first.detach().numpy(), self._precision, "C"))
            beyond, last = (torch.from_numpy(each).to(first.dtype) for each in of_loops)
            return beyond, last
        most = AT_ONCE if first.device.type == "cpu" else AT_ONCE_ON_GPU
        parts = max(1, -(-len(first) * self._values // most))
        of_parts = amplitudes.chunk(parts) if amplitudes is not None else [None] * parts
        found = [
            self._beyond(part, units, of_part)
            for part, of_part in zip(first.chunk(parts), of_parts, strict=False)
        ]
        every, lasts = zip(*found, strict=True)
        return torch.cat(every), torch.cat(lasts)

    def _beyond(
        self, first: Tensor, units: FollowingTerms | None, amplitudes: Tensor | None
    ) -> tuple[Tensor, Tensor]:
        terms, c = self.combination(first, units, amplitudes)
        last = c[:, -1, None, None] * terms[-1]
        beyond = (c[:, 0, None, None] - 1) * terms[0]
        for k, term in enumerate(terms[1:], 1):
            beyond = beyond + c[:, k, None, None] * term
        return beyond.to(first.dtype), last.to(first.dtype)

    def combination(
        self,
        first: Tensor,
        units: FollowingTerms | None = None,
        amplitudes: Tensor | None = None,
    ) -> tuple[list[Tensor], Tensor]:
        """Terms in m, (N, n_points, d), and their weights, (N, n), of u₁."""
        u, h = self.terms(first, units, amplitudes)
        works = None
        if units is not None and amplitudes is not None:
            works = units.works(amplitudes, u)
        c = self._weights(h, works)
        is_small = h[:, :, 0].abs().amax((0, 1, 2, 4)) <= SMALL
        return u, torch.where(is_small[:, None], torch.ones_like(c), c)

    def terms(
        self,
        first: Tensor,
        units: FollowingTerms | None = None,
        amplitudes: Tensor | None = None,
    ) -> tuple[list[Tensor], Tensor]:
        """u₁, u₂, … in m, (N, n_points, d), and gradients (d, d, n, n_cells, N, n_points), of u₁.

        Responses are in the precision of u₁.
        """
        solid, path, u = self.solid, StressPath(self.solid), [first.double()]
        slopes = [solid.slopes(u[0])[:, :, None]]
        while len(u) < self.order:
            path.add(slopes[-1])
            forces = -solid.forces_of(path.next_stress()[:, :, 0])
            if units is not None and amplitudes is not None:
                forces = forces + units.term(amplitudes, u)
            u.append(self._response(forces.to(first.dtype)).double())
            slopes.append(solid.slopes(u[-1])[:, :, None])
        return u, torch.cat(slopes, 2)

    def _response(self, forces: Tensor) -> Tensor:
        if self._respond is not None:
            return self._respond(forces)
        f = forces.detach().cpu().numpy() * self.equilibrium.free
        return torch.from_numpy(self.equilibrium.linear_response(f)).to(forces)
