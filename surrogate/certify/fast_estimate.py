r"""Errors and stability without a factorisation: a few steps of conjugate gradients.

Newton's step :math:`δ = -K(u)^{-1} r` (`surrogate.certify.full_certificate`) factorises the tangent
of every prediction. Here the factor of the undeformed body is kept, and its compliance is turned
with the body: with the rotations R of the nodes, :math:`P = R \, K(0)^{-1} R^T`, conjugate
gradients minimise :math:`\tfrac{1}{2} x · K(u) \, x + r · x` over

.. math:: x \in \mathrm{span} \, \{P r, \; P \, K(u) \, P r\}

so that :math:`x ≈ δ`, and the error is about :math:`-x`. In the norm of the energy, x is no larger
than δ. The forces s that are left move the body by :math:`K(u)^{-1} s`, which is about
:math:`P \, s / θ` at most in that norm, with the θ below. Under pressures that follow the surface
K(u) is the symmetric part of the tangent, and x is near the step of that part. Rotations are the
factors of the polar decomposition of the mean of :math:`F = I + ∇u` over the cells at a node. The
product with the tangent is that of the cells' stresses (`surrogate.certify.deformed_state`), which
no matrix is assembled for. A large body is treated in single precision, with out-of-balance forces
in a unit of the body's own, μ L^(d-1), so that their work does not underflow. Where a cell is
inverted, the error is infinite.

The same method sees whether K(u) is positive definite. The smallest eigenvalue θ of the tridiagonal
matrix of its coefficients is an upper bound of that of :math:`P \, K(u)`, which each step lowers
(Lanczos; Saad, *Iterative Methods for Sparse Linear Systems*, 2003, Section 6.7). Steps from r may
miss an instability, as that of a straight beam under an axial load, whose r has no part along its
buckling mode. So θ is also that of steps from a fixed load of random numbers, which has a part
along every mode. The compliance P makes the soft ones, in which bodies buckle, large.

All is written in NumPy, since a small body takes a few microseconds an operation. Components
come first: F is (d, d, n_points, N).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from shared_schema.common.bodies.polar_decomposition import Values, rotations
from shared_schema.common.errors import InputError
from shared_schema.material import Materials, NeoHookean
from surrogate.certify.deformed_state import MeanDilationState, State
from surrogate.data.geometry import Geometry
from surrogate.mechanics.follower_pressure import FollowerPressure
from surrogate.mechanics.out_of_balance import Equilibrium

Array = NDArray[np.float64]
LARGE = 4000  # degrees of freedom; operators are sparse from there on, numbers have 32 bits
AT_ONCE = 2**20  # values of a field at the points that are held at once
STEPS = 2  # of conjugate gradients from r
GENERIC_STEPS = 6  # from the load of random numbers
CONVERGED = 1e-10  # of the first work r · P r: smaller ones are rounding errors


class FastEstimate:
    """Estimated errors of predictions on one body.

    Parameters
    ----------
    geometry : Geometry
    material : NeoHookean
    equilibrium : Equilibrium
        Its layout and undeformed factor are used.

    Raises
    ------
    InputError
        If the material is another one, or there are several.
    """

    def __init__(self, geometry: Geometry, material: Materials, equilibrium: Equilibrium) -> None:
        if not isinstance(material, NeoHookean):
            raise InputError("--certify fast: expected one Neo-Hookean material, or 'full'")
        solid, layout = equilibrium.solid, equilibrium.layout
        large = len(layout.dofs) > LARGE
        self.dtype: type[np.floating[Any]] = np.float32 if large else np.float64
        self.material, self.free = material, equilibrium.free
        self.dimension, self.loadable = geometry.dimension, geometry.loadable
        self.units = equilibrium.units
        self._dofs = layout.dofs
        factor = equilibrium.undeformed
        self._factor = factor.single if large else factor
        gradients, volumes = solid.gradients.numpy(), solid.volumes.numpy()
        count, points, corners, d = gradients.shape
        self._shape = count, points
        self._cells = geometry.cells
        size = float(np.ptp(geometry.coordinates, axis=0).max())
        exponent = math.log2(material.lame_mu) + (d - 1) * math.log2(size)
        self._unit = self.dtype(2.0 ** round(exponent))  # of forces in N, without rounding
        self._state_at: Callable[[Values], State | MeanDilationState]
        self._state_at = partial(State, material=material)
        if equilibrium.mean_dilation:
            self._state_at = partial(MeanDilationState, material=material, volumes=volumes)
        self._weights: Values = volumes.reshape(-1, 1).astype(self.dtype)
        slopes = gradients.transpose(0, 1, 3, 2).reshape(count, points * d, corners)
        self._slopes_of: NDArray[Any] = np.ascontiguousarray(slopes.astype(self.dtype))
        self._summed: Any
        self._averaged: Any
        self._summed, self._averaged = (
            operator.astype(self.dtype) if large else operator.toarray()
            for operator in sums_at_nodes(geometry.cells, len(self.free))
        )
        self._at_once = max(1, AT_ONCE // (count * points * d**2))
        generic = np.random.default_rng(0).standard_normal((d, len(self.free), 1))
        self._generic: Values = self._balanced(generic).astype(self.dtype)

    def __call__(
        self, forces: Array, predicted: Array, pressure: FollowerPressure | None = None
    ) -> Array:
        """Estimate the predicted minus the true displacement in m: (N, n_nodes, d) → same.

        Parameters
        ----------
        forces, predicted : array, (N, n_nodes, d)
            Dead forces in N, and displacements in m. What is predicted for clamped nodes is wholly
            an error.
        pressure : FollowerPressure, optional
            Pressures of the N load cases.
        """
        return self._in_parts(forces, predicted, pressure, judged=False)[0]

    def with_stability(
        self, forces: Array, predicted: Array, pressure: FollowerPressure | None = None
    ) -> tuple[Array, Array, Array]:
        """Estimate the errors as a call does, and judge the stability of the predicted states.

        Returns
        -------
        error : array, (N, n_nodes, d)
            Estimate of the predicted minus the true displacement in m.
        rest : array, (N, n_nodes, d)
            Response P s in m to the forces that the estimate leaves out of balance; 0 where the
            error is infinite.
        softest : array, (N,)
            θ, which is 1 for the undeformed body; −∞ if a cell is inverted. If it is not positive,
            K(u) is not positive definite; its size then means nothing.
        """
        return self._in_parts(forces, predicted, pressure, judged=True)

    def _in_parts(
        self, forces: Array, predicted: Array, pressure: FollowerPressure | None, judged: bool
    ) -> tuple[Array, Array, Array]:
        error, rest = np.empty((2, *predicted.shape))
        softest = np.empty(len(predicted))
        for start in range(0, len(predicted), self._at_once):
            some = slice(start, start + self._at_once)
            push = None if pressure is None else pressure[some]
            found = self._estimated(forces[some], predicted[some], push, judged)
            error[some], rest[some], softest[some] = found
        return error, rest, softest

    def _estimated(
        self, forces: Array, predicted: Array, pressure: FollowerPressure | None, judged: bool
    ) -> tuple[Array, Array, Array]:
        held: Array = predicted * self.free
        pressed: list[csr_array] = []
        if pressure is not None:
            forces, pressed = forces + pressure.forces(held), pressure.symmetric_tangents(held)
        u = held.transpose(2, 1, 0).astype(self.dtype)  # (d, n_nodes, N)
        f = forces.transpose(2, 1, 0).astype(self.dtype)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            f_points = self._gradient(u)
            for i in range(self.dimension):
                f_points[i, i] += 1
            state, rotation = self._state_at(f_points), rotations(self._at_nodes(f_points))
            force = self._balanced(f - self._divergence(state.stress()))
            tangent = partial(self._tangent, state, pressed)
            x, left, softest = self._conjugate_gradients(tangent, rotation, force, STEPS)
            rest = np.zeros_like(x)
            if judged:
                rest = self._response(left, rotation)
                load = np.broadcast_to(self._generic, u.shape)
                _, _, found = self._conjugate_gradients(tangent, rotation, load, GENERIC_STEPS)
                softest = np.minimum(softest, found)
        x[..., ~state.sound] = np.inf
        kept: Array = np.where(np.isfinite(x), rest, 0).astype(np.float64).transpose(2, 1, 0)
        softest = np.where(state.sound, softest, -np.inf)
        return predicted - held - x.transpose(2, 1, 0), kept, softest

    def _tangent(
        self, state: State | MeanDilationState, pressed: list[csr_array], change: Values
    ) -> Values:
        """K(u) x in the unit of forces, of changes x in m: (d, n_nodes, N) → same."""
        forces = self._divergence(state.stress_change(self._gradient(change)))
        for case, matrix in enumerate(pressed):
            added = matrix @ change[..., case].T.ravel()
            forces[..., case] += added.reshape(-1, self.dimension).T
        return self._balanced(forces)

    def _conjugate_gradients(
        self, tangent_of: Callable[[Values], Values], rotation: Values, force: Values, steps: int
    ) -> tuple[Values, Values, Array]:
        """Do some steps towards K(u) x = force.

        Returns
        -------
        x, left : array, (d, n_nodes, N)
            The solution, and the force that it leaves out of balance.
        softest : array, (N,)
            Smallest Ritz value of P K(u) of these steps; +∞ if there is no force.
        """
        x, direction, before = np.zeros_like(force), np.zeros_like(force), np.inf
        works, curvatures, growths = [], [], []
        for step in range(steps):
            z = self._response(force, rotation)
            work = (force * z).sum((0, 1))
            growth = np.where(before > 0, work / before, 0)
            direction = z + growth * direction
            tangent = tangent_of(direction)
            curvature = (direction * tangent).sum((0, 1))
            length = work / curvature
            length = np.where((length > 0) & (length < np.inf), length, step == 0)
            x += length * direction
            force = force - length * tangent
            before = work
            works.append(work)
            curvatures.append(curvature)
            growths.append(growth)
        x[..., ~np.isfinite(work)] = np.inf
        return x, force, smallest_ritz_value(*map(np.array, (works, curvatures, growths)))

    def _gradient(self, u: Values) -> Values:
        """∂u_i/∂x_j at the quadrature points: (d, n_nodes, N) → (d, d, n_points, N)."""
        d, _, n = u.shape
        count, points = self._shape
        nodal = np.ascontiguousarray(u.transpose(1, 0, 2)).reshape(-1, d * n)
        slopes = (self._slopes_of @ nodal[self._cells]).reshape(count * points, d, d, n)
        return np.ascontiguousarray(slopes.transpose(2, 1, 0, 3))

    def _divergence(self, stress: Values) -> Values:
        """Nodal forces of stresses, Σ_q w_q P_q ∇N_a: (d, d, n_points, N) → (d, n_nodes, N)."""
        d, _, _, n = stress.shape
        count, points = self._shape
        weighted = np.ascontiguousarray((self._weights * stress).transpose(2, 1, 0, 3))
        forces = self._slopes_of.transpose(0, 2, 1) @ weighted.reshape(count, points * d, d * n)
        nodal: Values = self._summed @ forces.reshape(-1, d * n)
        return nodal.reshape(-1, d, n).transpose(1, 0, 2)

    def _at_nodes(self, f: Values) -> Values:
        """Mean over the points of the cells at a node: (d, d, n_points, N) → (d, d, n_nodes, N)."""
        d, _, _, n = f.shape
        means = f.reshape(d * d, *self._shape, n).mean(axis=2)
        columns = np.ascontiguousarray(means.transpose(1, 0, 2)).reshape(-1, d * d * n)
        nodal = (self._averaged @ columns).reshape(-1, d, d, n)
        return np.ascontiguousarray(nodal.transpose(1, 2, 0, 3))

    def _balanced(self, forces: Values) -> Values:
        """Forces at free nodes in their unit, from N; zero at clamped ones."""
        return forces * (self.free.T[:, :, None] / self._unit)

    def _response(self, force: Values, rotation: Values) -> Values:
        """P f = R K(0)⁻¹ Rᵀ f, of forces in their unit to m: (d, n_nodes, N) → same."""
        d, nodes, n = force.shape
        turned = (rotation * force[:, None]).sum(0).transpose(1, 0, 2).reshape(nodes * d, n)
        response = np.zeros_like(turned)
        response[self._dofs] = self._factor.solve(turned[self._dofs]) * self._unit
        back = response.reshape(nodes, d, n).transpose(1, 0, 2)
        return (rotation * back[None]).sum(1)


def smallest_ritz_value(works: Array, curvatures: Array, growths: Array) -> Array:
    """Smallest eigenvalue of the tridiagonal matrix of conjugate gradients, (N,).

    Parameters
    ----------
    works, curvatures, growths : array, (n_steps, N)
        r · P r, p · K p, and the part of the direction p before in the next one. Steps after
        convergence, where r is made of rounding errors, are left out.

    Returns
    -------
    array, (N,)
        +∞ if there is no step, −∞ if a number is not finite.
    """
    count, samples = works.shape
    left_out = np.logical_or.accumulate(works <= CONVERGED * works[0])
    inverse = curvatures / works  # of the lengths of the steps
    matrix = np.zeros((samples, count, count))
    for k in range(count):
        matrix[:, k, k] = inverse[k] + (growths[k] * inverse[k - 1] if k else 0)
        if k:
            beside = np.sqrt(growths[k]) * inverse[k - 1]
            matrix[:, k, k - 1] = matrix[:, k - 1, k] = np.where(left_out[k], 0, beside)
            matrix[:, k, k] = np.where(left_out[k], matrix[:, 0, 0], matrix[:, k, k])
    finite = np.isfinite(matrix).all(axis=(1, 2))
    found = np.full(samples, -np.inf)
    found[finite] = np.linalg.eigvalsh(matrix[finite])[:, 0]
    return np.where(left_out[0], np.inf, found)


def sums_at_nodes(cells: NDArray[np.int64], nodes: int) -> tuple[csr_array, csr_array]:
    """Sums of the values of corners, and means of the values of cells, at nodes.

    Returns
    -------
    summed : csr_array, (n_nodes, n_cells · n_corners)
    averaged : csr_array, (n_nodes, n_cells)
    """
    count, corners = cells.shape
    ones, at = np.ones(cells.size), cells.ravel()
    summed = coo_array((ones, (at, np.arange(cells.size))), shape=(nodes, cells.size))
    share = 1 / np.maximum(np.bincount(at, minlength=nodes), 1)
    of_cells = np.repeat(np.arange(count), corners)
    averaged = coo_array((share[at], (at, of_cells)), shape=(nodes, count))
    return summed.tocsr(), averaged.tocsr()
