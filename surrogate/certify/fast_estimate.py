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
product with the tangent is that of the cells' stresses (`surrogate.mechanics.solids.changes`), of
any material and element, which no matrix is assembled for. A large body is treated in single
precision, with out-of-balance forces in a unit of the body's own, μ L^(d-1), so that their work
does not underflow. Where a cell is inverted, the error is infinite.

The same method sees whether K(u) is positive definite. The smallest eigenvalue θ of the tridiagonal
matrix of its coefficients is an upper bound of that of :math:`P \, K(u)`, which each step lowers
(Lanczos; Saad, *Iterative Methods for Sparse Linear Systems*, 2003, Section 6.7). Steps from r may
miss an instability, as that of a straight beam under an axial load, whose r has no part along its
buckling mode. So θ is also that of steps from a fixed load of random numbers, which has a part
along every mode. The compliance P makes the soft ones, in which bodies buckle, large.

Elements may have points between the nodes, at which nothing is predicted. They move from their
interpolation to where they are in equilibrium, as those of a full certificate
(`surrogate.mechanics.quadratic`), by the same steps on the body whose nodes are held. What these
leave is a part of r.

All is written in NumPy, since a small body takes a few microseconds an operation; on a GPU the same
code takes tensors. Components come first: u is (d, n_nodes, N) and F is (d, d, n_cells, n_points of
a cell, N).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from shared_schema.common.bodies.array_library import library_of
from shared_schema.common.bodies.polar_decomposition import Values, cofactors, rotations
from surrogate.certify.conjugate_gradients import ConjugateGradients, smallest_ritz_value
from surrogate.cuda_graphs import Replayed
from surrogate.mechanics.block_solve import BlockSolve, SparseProduct
from surrogate.mechanics.compliance import in_single_precision
from surrogate.mechanics.follower_pressure import FollowerPressure
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.mechanics.quadratic import QuadraticEquilibrium
from surrogate.mechanics.solids.changes import Stresses
from surrogate.mechanics.solids.solid import Points
from surrogate.mechanics.solids.taylor_hood import TaylorHoodSolid

Array = NDArray[np.float64]
LARGE = 4000  # degrees of freedom; operators are sparse from there on, numbers have 32 bits
AT_ONCE = 2**20  # values of a field at the points that are held at once
AT_ONCE_ON_GPU = 2**26
FEW = 4  # load cases up to which launching the kernels one by one takes longest
FEW_COLUMNS = 12  # of the values of a cell
STEPS = 2  # of conjugate gradients from r
GENERIC_STEPS = 6  # from the load of random numbers
ROUNDS = 3  # of steps of the points between the nodes
DENSE = 2**16  # entries of an operator up to which it is a dense matrix


class FastEstimate:
    """Estimated errors of predictions on one body.

    Parameters
    ----------
    equilibrium : Equilibrium
        Its elements, materials, supports, layout and undeformed factor are used.
    blocks : BlockSolve, optional
        On a GPU, where the estimates are then computed; no factor is needed. It has no pressures,
        and the elements have no points between the nodes.
    """

    def __init__(self, equilibrium: Equilibrium, blocks: BlockSolve | None = None) -> None:
        geometry, solid, layout = equilibrium.geometry, equilibrium.solid, equilibrium.layout
        large = len(layout.dofs) > LARGE
        self.dtype: type[np.floating[Any]] = np.float32 if large else np.float64
        self.equilibrium, self.free = equilibrium, equilibrium.free
        self.dimension, self.loadable = geometry.dimension, geometry.loadable
        self.units = equilibrium.units
        self._device = None if blocks is None else blocks.order.device
        self._factor: Any = blocks
        self._dofs: Any = layout.dofs if blocks is None else self._placed(blocks.dofs)
        if blocks is None:
            factor = equilibrium.undeformed
            self._factor = in_single_precision(factor, len(layout.dofs)) if large else factor
        gradients, volumes = solid.gradients.numpy(), solid.volumes.numpy()
        count, points, corners, d = gradients.shape
        self._shape = count, points
        self._cells: Any = self._placed(geometry.cells)
        size = float(np.ptp(geometry.coordinates, axis=0).max())
        exponent = math.log2(solid.materials[0].lame_mu) + (d - 1) * math.log2(size)
        self._unit = float(2.0 ** round(exponent))  # of forces in N, without rounding
        self._weights: Values = self._placed(volumes[..., None])
        self._shares = self._weights / self._weights.sum(1)[:, None]
        slopes = gradients.transpose(0, 1, 3, 2).reshape(count, points * d, corners)
        self._slopes_of: Any = self._placed(slopes)
        self._to_corners: Any = self._slopes_of.swapaxes(1, 2)
        self._held: Values = self._placed(self.free.T[:, :, None] / self._unit)
        self._summed, self._averaged = (
            self._operator(operator, large)
            for operator in sums_at_nodes(geometry.cells, len(self.free))
        )
        self.laws, self.projects = solid.laws, solid.projects
        self.members: list[Any] = [self._placed(np.asarray(some)) for some in solid.members]
        order = np.argsort(np.concatenate(solid.members)) if solid.members else np.zeros(0, int)
        self._order: Any = self._placed(order)
        self._fibres: Any = None
        if solid.fibres is not None:
            self._fibres = self._placed(solid.fibres.numpy())
        at_once = AT_ONCE if blocks is None else AT_ONCE_ON_GPU
        self._at_once = max(1, at_once // (count * points * d**2))
        self._graphs = {
            judged: Replayed(partial(self._steps, judged=judged)) for judged in (False, True)
        }
        generic = np.random.default_rng(0).standard_normal((d, len(self.free), 1))
        self._generic: Values = self._balanced(self._placed(generic))

    @cached_property
    def _between(self) -> FastEstimate | None:
        """The same of the body whose nodes are held; None without points between them."""
        body = self.equilibrium
        return FastEstimate(body.held_at_nodes) if isinstance(body, QuadraticEquilibrium) else None

    def _placed(self, values: NDArray[Any]) -> Any:
        """Values where the estimates are computed, and in their precision if they are no counts."""
        precision = self.dtype if values.dtype.kind == "f" else values.dtype
        found = np.ascontiguousarray(values.astype(precision))
        return found if self._device is None else torch.from_numpy(found).to(self._device)

    def _operator(self, matrix: csr_array, large: bool) -> Callable[[Values], Values]:
        """Product with a matrix: (columns, N) → (rows, N)."""
        if self._device is not None:
            product = SparseProduct(matrix, torch.float32 if large else torch.float64)
            return product.to(self._device)
        dense = not large and matrix.shape[0] * matrix.shape[1] <= DENSE
        operator = matrix.toarray() if dense else matrix.astype(self.dtype)
        return operator.dot

    def __call__(
        self, forces: Array, predicted: Array, pressure: FollowerPressure | None = None
    ) -> Array:
        """Estimate the predicted minus the true displacement in m: (N, n_nodes, d) → same.

        Parameters
        ----------
        forces : array, (N, n_nodes or n_points, d)
            Dead loads in N (`surrogate.mechanics.quadratic`).
        predicted : array, (N, n_nodes, d)
            Displacements in m. What is predicted for clamped nodes is wholly an error.
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
        softest, nodes = np.empty(len(predicted)), predicted.shape[1]
        body = self.equilibrium
        for start in range(0, len(predicted), self._at_once):
            some = slice(start, start + self._at_once)
            push = None if pressure is None else pressure[some]
            if push is not None:
                push = replace(push, coordinates=body.geometry.coordinates)
            f, held = body.forces_at_points(forces[some]), predicted[some] * self.free[:nodes]
            found = self._estimated(f, self._at_points(held, f, push), push, judged)
            x, left, softest[some] = found
            error[some] = predicted[some] - held - x[:, :nodes]
            rest[some] = left[:, :nodes]
        return error, rest, softest

    def _at_points(self, u: Array, f: Array, pressure: FollowerPressure | None) -> Array:
        """Displacements of all points in m, those between the nodes where they are balanced."""
        found = self.equilibrium.interpolated(u)
        if self._between is None:
            return found
        for _ in range(ROUNDS):
            x, _, _ = self._between._estimated(f, found, pressure, judged=False)
            found = found + np.where(np.isfinite(x), x, 0.0)
        return found

    def _estimated(
        self, forces: Array, held: Array, pressure: FollowerPressure | None, judged: bool
    ) -> tuple[Array, Array, Array]:
        """Find x and P s in m, and θ, at displacements of all points in m under forces in N.

        From (N, n_points, d) to the same, and (N,); x is infinite where a cell is inverted.
        """
        pressed: list[csr_array] = []
        if pressure is not None:
            forces, pressed = forces + pressure.forces(held), pressure.symmetric_tangents(held)
        u, f = (self._placed(field.transpose(2, 1, 0)) for field in (held, forces))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"), torch.inference_mode():
            if self._device is not None and u.shape[-1] <= FEW:
                found = self._graphs[judged](u, f)
            else:
                found = self._steps(u, f, pressed, judged=judged)
            x, rest, sound, *coefficients = map(on_cpu, found)
            softest = smallest_ritz_value(*coefficients[:3])
            if judged:
                softest = np.minimum(softest, smallest_ritz_value(*coefficients[3:]))
        x[..., ~sound] = np.inf
        kept: Array = np.where(np.isfinite(x), rest, 0).astype(np.float64).transpose(2, 1, 0)
        return x.transpose(2, 1, 0), kept, np.where(sound, softest, -np.inf)

    def _steps(
        self, u: Values, f: Values, pressed: Sequence[csr_array] = (), *, judged: bool
    ) -> tuple[Any, ...]:
        """Do the steps of displacements in m and forces in N: (d, n_nodes, N) each.

        Returns
        -------
        x, rest : array, (d, n_nodes, N)
            In m; the rest is 0 unless the state is judged.
        sound : array of bool, (N,)
        works, curvatures, growths : array, (n_steps, N)
            Of the steps, and then of those from the load of random numbers.
        """
        stresses = self.stresses(u)
        sound = stresses.inside.reshape(-1, u.shape[-1]).all(0)
        rotation = rotations(self._at_nodes(stresses.f))
        force = self._balanced(f) - self._balanced(self._divergence(stresses.stress))
        tangent = partial(self._tangent, stresses, pressed)
        library = library_of(u)
        runs = [ConjugateGradients(force)]
        if judged:
            runs.append(ConjugateGradients(library.broadcast_to(self._generic, u.shape)))
        for _ in range(STEPS):
            for run, z in zip(runs, self._responses(rotation, runs), strict=True):
                run.step(z, tangent)
        x = library.where(library.isfinite(runs[0].works[-1]), runs[0].x, np.inf)
        coefficients = map(library.stack, runs[0].coefficients)
        if not judged:
            return x, 0 * x, sound, *coefficients
        rest, z = self._responses(rotation, runs)
        generic = runs[1]
        generic.step(z, tangent)
        for _ in range(STEPS + 1, GENERIC_STEPS):
            (z,) = self._responses(rotation, [generic])
            generic.step(z, tangent)
        others = map(library.stack, generic.coefficients)
        return x, rest, sound, *coefficients, *others

    def stresses(self, u: Values) -> Stresses:
        """Stresses at displacements of all points in m, (d, n_points, N)."""
        f: Any = self._gradient(u)
        for i in range(self.dimension):
            f[i, i] += 1
        dilation: Any = self.projected(determinant(f)) if self.projects else None
        return Stresses(self, Points(f, dilation, fibres=self._fibres))

    def _tangent(self, stresses: Stresses, pressed: Sequence[csr_array], change: Values) -> Values:
        """K(u) x in the unit of forces, of changes x in m: (d, n_nodes, N) → same."""
        forces = self._divergence(stresses.change(self._gradient(change)))
        for case, matrix in enumerate(pressed):
            added = matrix @ change[..., case].T.ravel()
            forces[..., case] += added.reshape(-1, self.dimension).T
        return self._balanced(forces)

    def _gradient(self, u: Values) -> Values:
        """∂u_i/∂x_j at the quadrature points: (d, n_nodes, N) → (d, d, n_cells, n_points, N)."""
        d, _, n = u.shape
        count, points = self._shape
        nodal = u.swapaxes(0, 1).reshape(-1, d * n)
        slopes = of_cells(self._slopes_of, nodal[self._cells]).reshape(count * points, d, d, n)
        return contiguous(slopes.swapaxes(0, 2)).reshape(d, d, count, points, n)

    def _divergence(self, stress: Values) -> Values:
        """Nodal forces of stresses, Σ_q w_q P_q ∇N_a: (d, d, n_cells, …, N) → (d, n_nodes, N)."""
        d, n, (count, points) = len(stress), stress.shape[-1], self._shape
        weighted = (self._weights * stress).reshape(d, d, count * points, n).swapaxes(0, 2)
        forces = of_cells(self._to_corners, weighted.reshape(count, points * d, d * n))
        nodal = self._summed(forces.reshape(-1, d * n))
        return nodal.reshape(-1, d, n).swapaxes(0, 1)

    def _at_nodes(self, f: Values) -> Values:
        """Mean over the cells at a node: (d, d, n_cells, n_points, N) → (d, d, n_nodes, N)."""
        d, n = len(f), f.shape[-1]
        means = f.mean(3).reshape(d * d, -1, n)
        columns = means.swapaxes(0, 1).reshape(-1, d * d * n)
        nodal = self._averaged(columns).reshape(-1, d * d, n).swapaxes(0, 1)
        return contiguous(nodal).reshape(d, d, -1, n)

    def joined(self, parts: Sequence[Values]) -> Values:
        """Fields of the cells of all materials as one of all cells, the axis -3."""
        if len(parts) == 1:
            return parts[0]
        return library_of(parts[0]).concatenate(parts, -3)[..., self._order, :, :]

    def projected(self, values: Values) -> Values:
        """Π of values at the points: (n_cells, n_points, N) → same."""
        solid = self.equilibrium.solid
        if isinstance(solid, TaylorHoodSolid):
            given = torch.from_numpy(values.swapaxes(1, 2).astype(np.float64))
            return solid.projected(given).numpy().swapaxes(1, 2).astype(values.dtype)
        means: Values = library_of(values).broadcast_to(
            (values * self._shares).sum(1)[:, None], values.shape
        )
        return means

    def _balanced(self, forces: Values) -> Values:
        """Forces at free nodes in their unit, from N; zero at clamped ones."""
        balanced: Values = forces * self._held
        return balanced

    def _responses(
        self, rotation: Values, runs: Sequence[ConjugateGradients]
    ) -> tuple[Values, ...]:
        """P f = R K(0)⁻¹ Rᵀ f of the forces that are left in some runs, by one solution.

        They are in their unit, displacements in m: (d, n_nodes, N) → same.
        """
        d, nodes, n = runs[0].force.shape
        library = library_of(rotation)
        turned = [(rotation * run.force[:, None]).sum(0).swapaxes(0, 1) for run in runs]
        columns = library.concatenate([each.reshape(nodes * d, n) for each in turned], 1)
        response = library.zeros_like(columns)
        solved = self._factor.solve(columns[self._dofs]) * self._unit
        response[self._dofs] = solved if self._device is None else solved.to(response.dtype)
        back = response.reshape(nodes, d, len(runs), n).swapaxes(0, 1)
        return tuple((rotation * back[None, :, :, i]).sum(1) for i in range(len(runs)))


def determinant(f: Values) -> Values:
    """J = det F: (d, d, …) → (…)."""
    j: Values = (f[0] * cofactors(f)[0]).sum(0)
    return j


def of_cells(matrices: Any, values: Any) -> Any:
    """Products of small matrices, cell by cell: (n_cells, n, m), (n_cells, m, k) → (n_cells, n, k).

    A GPU adds up their terms faster than it multiplies matrices of a few rows.
    """
    if library_of(values) is np or values.shape[-1] > FEW_COLUMNS:
        return matrices @ values
    return (matrices[..., None] * values[:, None]).sum(2)


def contiguous(values: Any) -> Values:
    """The same values in the order of their axes."""
    found = np.ascontiguousarray(values) if library_of(values) is np else values.contiguous()
    result: Values = found
    return result


def on_cpu(values: Any) -> NDArray[Any]:
    """The values as an array."""
    return np.asarray(values if library_of(values) is np else values.cpu().numpy())


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
