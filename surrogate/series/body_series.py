r"""The load series of any body: displacements as combinations of the terms of a power series.

Under s times a load, dead forces f and pressures that follow the surface,

.. math::
    u(s) = \sum_k s^k u_k, \qquad K u_1 = f + f_{p,1}, \qquad
    K u_k = f_{p,k} - \sum_q w_q \, \hat P_{k,q} G_a

with the stiffness K of the undeformed body, the part P̂ₖ of the k-th term of the stress that
follows from those before (`surrogate.series.measured_series`), and the terms of the pressures'
forces, which are polynomials of the displacement. What the terms span is much better than their
sum: it is the reduced basis of A. K. Noor and J. M. Peters (*Reduced basis technique for nonlinear
analysis of structures*, AIAA Journal 18, 1980). The combination is that of Galerkin,

.. math:: u = \sum_{k=1}^n c_k u_k, \qquad g_k(c) = u_k · r(u) = 0,

with the out-of-balance forces r, which is that of least potential energy where there is one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from surrogate.mechanics.compliance import Compliance
from surrogate.mechanics.follower_pressure import FollowerPressure
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.mechanics.solids.changes import Stresses
from surrogate.mechanics.solids.solid import Solid
from surrogate.series.measured_series import SeriesOfLaw, sum_of, trace

Array = NDArray[np.float64]
COMPILES = find_spec("numba") is not None  # a machine that only trains may do without it
STEPS = 30  # of the search for the weights, at most
SMALL_STEP, SMALLEST_STEP = 3e-3, 1e-10  # relative to the last term, and to the first one
SHORTENINGS = 10
SMALL = 1e-5  # gradients whose sum of terms, all weights 1, is right to rounding
TINY = 1e-300


@dataclass(frozen=True)
class SeriesTerms:
    """Terms of the series of N loads.

    Attributes
    ----------
    u : array, (n, N, n_points, d)
        uₖ in m.
    gradients : list of n Tensors, (d, d, n_cells, N, n_points)
        Hₖ.
    """

    u: Array
    gradients: list[Tensor]


class BodySeries:
    """Load series of one body.

    Parameters
    ----------
    equilibrium : Equilibrium
        Its elements, materials and factor of K are used; displacements and forces are of all its
        points.
    order : int
        Order n.
    compliance : Compliance, optional
        K⁻¹ of the same nodes: it keeps columns, and answers for a large body in single precision.
    """

    def __init__(
        self, equilibrium: Equilibrium, order: int, compliance: Compliance | None = None
    ) -> None:
        self.equilibrium, self.order, self.compliance = equilibrium, order, compliance

    @cached_property
    def _compiled(self) -> Callable[[Array], tuple[Array, Array]] | None:
        """The series under dead loads alone, where compiled code knows the body."""
        solid, size = self.equilibrium.solid, self.equilibrium.free.size
        fibres = any(material.family_count for material in solid.materials)
        if solid.projects or fibres or not COMPILES:
            return None
        from surrogate.series.compiled_series import CompiledSeries  # Numba: half a second
        from surrogate.series.small_series import SmallSeries

        respond = self.equilibrium.linear_response
        if SmallSeries.fits(solid, size):
            units = np.eye(size).reshape(size, *self.equilibrium.free.shape)
            return SmallSeries(solid, respond(units).reshape(size, size), self.order)
        if self.compliance is None:
            return CompiledSeries(solid, np.float64, respond, self.order).of_forces
        precision = np.float64 if len(self.compliance.matrix) else np.float32
        kept = self.compliance.respond_at_nodes
        return CompiledSeries(solid, precision, kept, self.order).of_forces

    def __call__(
        self, forces: Array, pressure: FollowerPressure | None = None
    ) -> tuple[Array, Array]:
        """Predict displacements, and tell how much the last term changes them.

        Parameters
        ----------
        forces : array, (N, n_points, d)
            Dead ones in N.
        pressure : FollowerPressure, optional
            Pressures of the N load cases.

        Returns
        -------
        displacements : array, (N, n_points, d)
            In m.
        last : array, (N,)
            Largest displacement of a point in the last term in m.
        """
        if self._compiled is not None and (pressure is None or not pressure.pressures.any()):
            return self._compiled(forces)
        terms = self.terms(forces, pressure)
        weights = Weights(self.equilibrium, terms, forces, pressure).found()
        displacement = np.einsum("nk,knai->nai", weights, terms.u)
        last = np.linalg.norm(weights[:, -1, None, None] * terms.u[-1], axis=2).max(axis=1)
        return displacement, last

    def terms(self, forces: Array, pressure: FollowerPressure | None = None) -> SeriesTerms:
        """Compute the terms of some loads, as of a call."""
        body, solid = self.equilibrium, self.equilibrium.solid
        series = SeriesOfBody(solid)
        push = None if pressure is None else PressureSeries(pressure)
        acting = forces.copy()
        u: list[Array] = []
        gradients: list[Tensor] = []
        for k in range(1, self.order + 1):
            if push is not None:
                acting += push.next(u)
            response = body.linear_response(acting * body.free)
            u.append(response)
            slope = slope_of(solid, response)
            gradients.append(slope)
            series.add(slope)
            if k < self.order:
                acting = -solid.forces_of(series.next_stress()).numpy()
        return SeriesTerms(np.array(u), gradients)


def slope_of(solid: Solid, u: Array) -> Tensor:
    """∇u at the quadrature points: (N, n_points, d) → (d, d, n_cells, N, n_points)."""
    f = solid.deformation_gradient(torch.from_numpy(u))
    for i in range(len(f)):
        f[i, i] -= 1
    return f


class SeriesOfBody:
    """Terms of the stress of a body, of one law after the other.

    Parameters
    ----------
    solid : Solid
    """

    def __init__(self, solid: Solid) -> None:
        self.solid, d = solid, solid.gradients.shape[3]
        self._laws = []
        for number, law in enumerate(solid.laws):
            fibres: list[Tensor] = []
            if solid.fibres is not None and law.families:
                some = solid.members[number] if solid.members else slice(None)
                fibres = list(solid.fibres[: law.families, :, some])
            self._laws.append(SeriesOfLaw(law, d, fibres))
        self._begun = False

    def add(self, h: Tensor) -> None:
        """Set the next H, (d, d, n_cells, N, n_points)."""
        if not self._begun:
            self._begin(h)
        self._begun = False
        gain = self.solid.projected(trace(h)) if self.solid.projects else None
        for law, some, of_some in self._parts(h, gain):
            law.complete(some, of_some)
        if gain is not None:
            slopes = [law.pressure_gain() for law in self._laws]
            more = self.solid.projected(self._joined(slopes))
            for law, _, of_some in self._parts(h, more):
                law.pressure[-1] = sum_of(law.pressure[-1], of_some)

    def next_stress(self) -> Tensor:
        """The next P without what is linear in H, likewise."""
        return self._begin(torch.zeros_like(self._joined([law.h[-1] for law in self._laws])))

    def _begin(self, like: Tensor) -> Tensor:
        volumes = [law.begin(some) for law, some, _ in self._parts(like, None) if some is not None]
        dilation = pressure = None
        if self.solid.projects:
            dilation = self.solid.projected(self._joined(volumes))
        slopes = []
        for law, _, some in self._parts(like, dilation):
            slope = law.scalars(some)
            slopes.append(torch.zeros_like(law.h[-1][0, 0]) if slope is None else slope)
        if self.solid.projects:
            pressure = self.solid.projected(self._joined(slopes))
        stresses = [law.stress(some) for law, _, some in self._parts(like, pressure)]
        self._begun = True
        return self._joined(stresses)

    def _parts(
        self, tensor: Tensor, scalar: Tensor | None
    ) -> list[tuple[SeriesOfLaw, Tensor, Tensor | None]]:
        """Every law with its part of fields (d, d, n_cells, …) and (n_cells, …)."""
        if len(self._laws) == 1:
            return [(self._laws[0], tensor, scalar)]
        members = self.solid.members
        return [
            (law, tensor[:, :, some], None if scalar is None else scalar[some])
            for law, some in zip(self._laws, members, strict=True)
        ]

    def _joined(self, parts: list[Tensor]) -> Tensor:
        return self.solid.joined(parts)


class PressureSeries:
    """Terms of the forces of pressures: those of s p on the body displaced by Σ sᵏ uₖ."""

    def __init__(self, pressure: FollowerPressure) -> None:
        self.pressure = pressure

    def next(self, u: list[Array]) -> Array:
        """Forces of the order after that of the last of some terms, (N, n_points, d) in m → N.

        They are those of products of two terms, or one and the positions at rest; forces are
        polynomials of the positions, so that sums and differences tell products.
        """
        pressure, k = self.pressure, len(u)
        if k == 0:
            return pressure.at_rest
        d = pressure.coordinates.shape[1]
        if d == 2:
            return pressure.forces(u[-1]) - pressure.at_rest
        # B(x, y) of the quadratic form f(x) = B(x, x): terms of f(Σ) of degree k
        at_rest = -pressure.coordinates  # forces() add the coordinates
        total = pressure.forces(u[-1]) - pressure.forces(-u[-1])  # 4 B(X, u_k) / 2
        total = total / 2
        for i in range(1, k // 2 + 1):
            a, b = u[i - 1], u[k - i - 1]
            if 2 * i == k:
                total = total + pressure.forces(at_rest + a)
            else:
                total = (
                    total
                    + (pressure.forces(at_rest + a + b) - pressure.forces(at_rest + a - b)) / 2
                )
        return total


class Weights:
    """The search for the weights of Galerkin's combination, of N loads at once.

    Newton's method, from terms that fade where they do not decrease. A step is taken if it comes
    closer to the solution, by the simplified step from its end (Deuflhard 2004, Section 3.3).

    Parameters
    ----------
    equilibrium : Equilibrium
    terms : SeriesTerms
    forces : array, (N, n_points, d)
        Dead ones in N.
    pressure : FollowerPressure or None
    """

    def __init__(
        self,
        equilibrium: Equilibrium,
        terms: SeriesTerms,
        forces: Array,
        pressure: FollowerPressure | None,
    ) -> None:
        self.solid, self.u, self.pressure = equilibrium.solid, terms.u, pressure
        self.free = equilibrium.free
        self.h = torch.stack(terms.gradients)
        self.works = np.einsum("knai,nai->nk", terms.u, forces)
        self.volumes = self.solid.volumes[:, None]
        squares = (self.volumes * (self.h * self.h).sum((1, 2))).sum((1, 3)).numpy().T
        self.scale = (squares + TINY) ** -0.5
        ratios = squares[:, 1:] / (squares[:, :-1] + TINY)
        self.start = np.cumprod(np.pad(1 / (1 + ratios**2), ((0, 0), (1, 0)), constant_values=1), 1)
        self.is_small = self.h[0].abs().amax((0, 1, 2, 4)).numpy() <= SMALL

    def found(self) -> Array:
        """Weights of every load, (N, n)."""
        c = np.ones(self.start.shape)
        for row in np.flatnonzero(~self.is_small):
            c[row] = self._of(slice(row, row + 1))
        return c

    def _of(self, one: slice) -> Array:
        """Weights of a single load, (n,)."""
        c, scale = self.start[one][0], self.scale[one][0]
        halves = 0.5 ** np.arange(1, len(c) + 1)
        found = self._at(one, c)
        for _ in range(STEPS):
            if found is None:
                c = c * halves
                found = self._at(one, c)
                continue
            g, matrix = found
            scaled = matrix * scale[:, None] * scale
            scaled += 1e-9 * np.diag(np.abs(np.diagonal(scaled)) + TINY)
            step = -np.linalg.solve(scaled, scale * g)
            size = float(np.linalg.norm(step))
            small = SMALL_STEP * abs(c[-1] / scale[-1]) + SMALLEST_STEP / scale[0]
            part = 1.0
            for _ in range(SHORTENINGS):
                trial = c + part * scale * step
                after = self._at(one, trial)
                if after is not None:
                    simplified = np.linalg.solve(scaled, scale * after[0])
                    if np.linalg.norm(simplified) <= (1 - part / 4) * size + small:
                        break
                part /= 2
            else:
                return c
            c, found = trial, after
            if size <= small:
                break
        return c

    def _at(self, one: slice, c: Array) -> tuple[Array, Array] | None:
        """Residual g and its derivative at some weights; None where cells are inverted."""
        h = self.h[:, :, :, :, one]
        f = torch.einsum("k,kijcnq->ijcnq", torch.from_numpy(c), h)
        for i in range(len(f)):
            f[i, i] += 1
        points = self.solid.at(f)
        if bool(self.solid.turned_over(points)[0]):
            return None
        stresses = Stresses(self.solid, points)
        stress = self.volumes * stresses.stress
        g = torch.einsum("ijcnq,kijcnq->k", stress, h).numpy() - self.works[one][0]
        changes = [self.volumes * stresses.change(each) for each in h]
        matrix = torch.einsum("lijcnq,kijcnq->kl", torch.stack(changes), h).numpy()
        if self.pressure is not None:
            u, push = self.u[:, one], self.pressure[one]
            at = np.einsum("k,knai->nai", c, u)
            g = g - np.einsum("nai,knai->k", push.forces(at), u)
            for _, facets, blocks in push.tangents(at):
                local = u[:, 0][:, facets].reshape(len(u), len(facets), -1)
                matrix = matrix + np.einsum("kfi,fij,lfj->kl", local, blocks, local)
        return (g, matrix) if np.isfinite(g).all() and np.isfinite(matrix).all() else None
