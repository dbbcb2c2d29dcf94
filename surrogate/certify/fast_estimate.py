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

All is written in NumPy, since a small body takes a few microseconds an operation; on a GPU the same
code takes tensors. Components come first: F is (d, d, n_points, N).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from shared_schema.common.bodies.array_library import library_of
from shared_schema.common.bodies.polar_decomposition import Values, rotations
from shared_schema.common.errors import InputError
from shared_schema.materials import Materials
from surrogate.certify.conjugate_gradients import ConjugateGradients, smallest_ritz_value
from surrogate.certify.deformed_state import MeanDilationState, State
from surrogate.cuda_graphs import Replayed
from surrogate.data.geometry import Geometry
from surrogate.mechanics.block_solve import BlockSolve, SparseProduct
from surrogate.mechanics.follower_pressure import FollowerPressure
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.mechanics.solids.zones import material_of_zones, weights_of_zones

Array = NDArray[np.float64]
LARGE = 4000  # degrees of freedom; operators are sparse from there on, numbers have 32 bits
AT_ONCE = 2**20  # values of a field at the points that are held at once
AT_ONCE_ON_GPU = 2**26
FEW = 4  # load cases up to which launching the kernels one by one takes longest
FEW_COLUMNS = 12  # of the values of a cell
STEPS = 2  # of conjugate gradients from r
GENERIC_STEPS = 6  # from the load of random numbers


class FastEstimate:
    """Estimated errors of predictions on one body.

    Parameters
    ----------
    geometry : Geometry
    material : NeoHookean, or tuple of some that differ in Young's modulus alone
    equilibrium : Equilibrium
        Its layout and undeformed factor are used.
    blocks : BlockSolve, optional
        On a GPU, where the estimates are then computed; no factor is needed. It has no pressures.

    Raises
    ------
    InputError
        If the material is another one.
    """

    def __init__(
        self,
        geometry: Geometry,
        material: Materials,
        equilibrium: Equilibrium,
        blocks: BlockSolve | None = None,
    ) -> None:
        zone = material_of_zones(material)
        if zone is None:
            raise InputError(
                "--certify fast: expected one Neo-Hookean material, or some that differ in "
                "'young_modulus' alone; else 'full'"
            )
        solid, layout = equilibrium.solid, equilibrium.layout
        large = len(layout.dofs) > LARGE
        self.dtype: type[np.floating[Any]] = np.float32 if large else np.float64
        self.material, self.free = zone, equilibrium.free
        self.dimension, self.loadable = geometry.dimension, geometry.loadable
        self.units = equilibrium.units
        self._device = None if blocks is None else blocks.order.device
        self._factor: Any = blocks
        self._dofs: Any = layout.dofs if blocks is None else self._placed(blocks.dofs)
        if blocks is None:
            factor = equilibrium.undeformed
            self._factor = factor.single if large else factor
        gradients, volumes = solid.gradients.numpy(), weights_of_zones(solid).numpy()
        count, points, corners, d = gradients.shape
        self._shape = count, points
        self._cells: Any = self._placed(geometry.cells)
        size = float(np.ptp(geometry.coordinates, axis=0).max())
        exponent = math.log2(zone.lame_mu) + (d - 1) * math.log2(size)
        self._unit = float(2.0 ** round(exponent))  # of forces in N, without rounding
        self._state_at: Callable[[Values], State | MeanDilationState]
        self._state_at = partial(State, material=zone)
        if equilibrium.mean_dilation:
            shares = self._placed((volumes / volumes.sum(axis=1, keepdims=True))[..., None])
            self._state_at = partial(MeanDilationState, material=zone, shares=shares)
        self._weights: Values = self._placed(volumes.reshape(-1, 1))
        slopes = gradients.transpose(0, 1, 3, 2).reshape(count, points * d, corners)
        self._slopes_of: Any = self._placed(slopes)
        self._to_corners: Any = self._slopes_of.swapaxes(1, 2)
        self._held: Values = self._placed(self.free.T[:, :, None] / self._unit)
        self._summed, self._averaged = (
            self._operator(operator, large)
            for operator in sums_at_nodes(geometry.cells, len(self.free))
        )
        at_once = AT_ONCE if blocks is None else AT_ONCE_ON_GPU
        self._at_once = max(1, at_once // (count * points * d**2))
        self._graphs = {
            judged: Replayed(partial(self._steps, judged=judged)) for judged in (False, True)
        }
        generic = np.random.default_rng(0).standard_normal((d, len(self.free), 1))
        self._generic: Values = self._balanced(self._placed(generic))

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
        operator = matrix.astype(self.dtype) if large else matrix.toarray()
        return operator.dot

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
        return predicted - held - x.transpose(2, 1, 0), kept, np.where(sound, softest, -np.inf)

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
        f_points = self._gradient(u)
        for i in range(self.dimension):
            f_points[i, i] += 1
        state, rotation = self._state_at(f_points), rotations(self._at_nodes(f_points))
        force = self._balanced(f) - self._balanced(self._divergence(state.stress()))
        tangent = partial(self._tangent, state, pressed)
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
            return x, 0 * x, state.sound, *coefficients
        rest, z = self._responses(rotation, runs)
        generic = runs[1]
        generic.step(z, tangent)
        for _ in range(STEPS + 1, GENERIC_STEPS):
            (z,) = self._responses(rotation, [generic])
            generic.step(z, tangent)
        others = map(library.stack, generic.coefficients)
        return x, rest, state.sound, *coefficients, *others

    def _tangent(
        self, state: State | MeanDilationState, pressed: Sequence[csr_array], change: Values
    ) -> Values:
        """K(u) x in the unit of forces, of changes x in m: (d, n_nodes, N) → same."""
        forces = self._divergence(state.stress_change(self._gradient(change)))
        for case, matrix in enumerate(pressed):
            added = matrix @ change[..., case].T.ravel()
            forces[..., case] += added.reshape(-1, self.dimension).T
        return self._balanced(forces)

    def _gradient(self, u: Values) -> Values:
        """∂u_i/∂x_j at the quadrature points: (d, n_nodes, N) → (d, d, n_points, N)."""
        d, _, n = u.shape
        count, points = self._shape
        nodal = u.swapaxes(0, 1).reshape(-1, d * n)
        slopes = of_cells(self._slopes_of, nodal[self._cells]).reshape(count * points, d, d, n)
        return contiguous(slopes.swapaxes(0, 2))

    def _divergence(self, stress: Values) -> Values:
        """Nodal forces of stresses, Σ_q w_q P_q ∇N_a: (d, d, n_points, N) → (d, n_nodes, N)."""
        d, _, _, n = stress.shape
        count, points = self._shape
        weighted = (self._weights * stress).swapaxes(0, 2)
        forces = of_cells(self._to_corners, weighted.reshape(count, points * d, d * n))
        nodal = self._summed(forces.reshape(-1, d * n))
        return nodal.reshape(-1, d, n).swapaxes(0, 1)

    def _at_nodes(self, f: Values) -> Values:
        """Mean over the points of the cells at a node: (d, d, n_points, N) → (d, d, n_nodes, N)."""
        d, _, _, n = f.shape
        means = f.reshape(d * d, *self._shape, n).mean(axis=2)
        columns = means.swapaxes(0, 1).reshape(-1, d * d * n)
        nodal = self._averaged(columns).reshape(-1, d * d, n).swapaxes(0, 1)
        return contiguous(nodal).reshape(d, d, -1, n)

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
