r"""Equilibrium of a solid under nodal forces: out-of-balance forces and Newton steps.

.. math::
    r(u) = f_{int}(u) - f = \frac{∂Π}{∂u}, \qquad Π(u) = E(u) - f · u, \qquad
    δ(u) = -K(u)^{-1} r(u), \qquad K = \frac{∂f_{int}}{∂u}

at the free degrees of freedom; held ones do not move. Equilibrium is r = 0, and δ is the step
of Newton's method towards it. Where K is not positive definite, δ is computed with K + τ K(0)
instead, with the first :math:`τ = 0.1 · 4^k` that is sufficient, so that Π decreases along δ.

Under loads that follow the body (`surrogate.mechanics.equilibrium.following_loads`),

.. math:: r(u) = f_{int}(u) - f - f_p(u), \qquad K = \frac{∂f_{int}}{∂u} - \frac{∂f_p}{∂u}.

K is not symmetric in general, so that Π does not exist; δ is always that of K itself. A state
counts as stable where the symmetric part of K is positive definite: then every small displacement
takes work. Springs to a rigid tool (`surrogate.mechanics.equilibrium.tool_springs`) add to Π, r and
K, and so does the inertia of a time step (`surrogate.mechanics.equilibrium.inertia`), also to K(0).
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.bodies.equilibrium import RoundOff, imperfection, mean_edge
from shared_schema.common.bodies.reference_cells import LINEAR
from shared_schema.common.units import SI
from shared_schema.materials import Materials, as_tuple
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium import quadratic
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.newton_steps import NewtonSteps
from surrogate.mechanics.equilibrium.tool_springs import ToolSprings
from surrogate.mechanics.matrices.factors import Factor, SymmetricFactor, in_single_precision
from surrogate.mechanics.matrices.layout import Layout
from surrogate.mechanics.matrices.saddle_point import saddle_point_layout
from surrogate.mechanics.solids.mixed_elements import MeanDilationSolid, TaylorHoodSolid
from surrogate.mechanics.solids.solid import Solid
from surrogate.runtime.time_limit import require_time

if TYPE_CHECKING:
    from surrogate.mechanics.equilibrium.inertia import Inertia

Array = NDArray[np.float64]
FIRST_SHIFT, SHIFT_GROWTH = 0.1, 4.0  # of τ
LEAST_SHIFT, INVERSE_ITERATIONS = 1e-8, 30  # of c, and for a mode
EPSILON = float(np.finfo(np.float64).eps)


class Equilibrium:
    """Equilibria of one body, in double precision.

    Displacements (N, n_nodes, d) are in m and forces, of the same shape, in N. Elements may have
    points between the nodes (`surrogate.mechanics.equilibrium.quadratic`); displacements and forces
    then hold those of all points, the nodes first.

    Parameters
    ----------
    geometry : Geometry
    material : ShippedMaterial, or tuple of some
    on_points : bool
        Whether elements have points between the nodes, which then are nodes of `geometry` here.

    Attributes
    ----------
    geometry : Geometry
        Its nodes are all points of the elements.
    points : PointsBetween or None
        Those between the nodes.
    nodes : int
        Number of the points that are nodes of the mesh.
    solid : Solid
    mean_dilation : bool
        Whether the volumes of its cells change as a whole.
    layout : Layout
        Order of the free degrees of freedom in K.
    free : array of bool, (n_nodes, d)
        Components that are not held.
    cell_size : float
        Mean length in m of one edge of the cells.
    rounding : float
        Bound of the rounding error of Π in J: 10 ε (λ + μ) times the body's volume.
    following : FollowingLoads or None
        Those of one load case, which act on all displacements (`under`).
    springs : ToolSprings or None
        Springs to a tool, which push all displacements (`against`).
    inertia : Inertia or None
        That of a time step, in which it is found (`moving`).
    units : Units
        Labels of what is computed here, for messages.
    """

    following: FollowingLoads | None = None
    springs: ToolSprings | None = None
    inertia: Inertia | None = None

    def __init__(self, geometry: Geometry, material: Materials, on_points: bool = False) -> None:
        self.nodes, self.points = len(geometry.coordinates), None
        if on_points:
            self.points, geometry = geometry.points_between, quadratic.on_points(geometry)
        body = geometry.coordinates, geometry.cells, geometry.cell_type
        self.geometry, self.material = geometry, material
        self.solid = solid_kind(geometry)(*body, material, geometry.parts, geometry.fibres)
        self.mean_dilation, self.free = geometry.mean_dilation, ~geometry.held
        moduli = max(m.lame_lambda + m.lame_mu for m in as_tuple(material))
        self.rounding = 10 * EPSILON * moduli * float(self.solid.volumes.sum())
        self.units = SI
        self._size = geometry.coordinates.size
        self.cell_size = mean_edge(geometry.coordinates, geometry.cells)
        if isinstance(self.solid, TaylorHoodSolid):
            corners = self.solid.corners.shape[1]
            units = self.cell_size, 2 * moduli  # λ + 2μ or more
            held, beside = geometry.held, geometry.cable_points
            self.layout = saddle_point_layout(geometry.cells, held, corners, *units, beside)
        else:
            mesh = geometry.coordinates, geometry.cells, geometry.held
            self.layout = Layout.of(*mesh, geometry.cable_points)

    def under(self, following: FollowingLoads) -> Equilibrium:
        """Return equilibria of the same body, under the following loads of one case as well."""
        body, at = self._same_body(), self.geometry.coordinates  # those of all points
        acts = following.amplitudes.any()
        body.following = replace(following, coordinates=at) if acts else None
        return body

    def against(self, springs: ToolSprings) -> Equilibrium:
        """Return equilibria of the same body with springs to a tool."""
        body = self._same_body()
        body.springs = springs
        return body

    def moving(self, inertia: Inertia) -> Equilibrium:
        """Return equilibria of the same body in a time step; factors are of this length of steps.

        The body may be one in another step already.
        """
        body, known = copy(self), self.inertia
        body.inertia = inertia
        if known is None or known.masses is not inertia.masses:
            for name in ("undeformed", "rough", "round_off", "of_masses"):
                body.__dict__.pop(name, None)
            body.__dict__["of_masses"] = self.layout.assembled(inertia.masses.tangents())[0]
        return body

    def _same_body(self) -> Equilibrium:
        """A copy, whose factor of K(0) is that of this body."""
        body, known = copy(self), {"undeformed": self.undeformed, "round_off": self.round_off}
        body.__dict__.update(known)
        return body

    @property
    def has_potential(self) -> bool:
        """Whether all forces are those of Π."""
        viscous = self.inertia is not None and self.inertia.masses.viscosity is not None
        return self.following is None and not viscous

    def at_points(self, u: Array, f: Array) -> Array:
        """Displacements of all points by those of the nodes in m, under forces f on all in N.

        From (N, n_nodes, d) to (N, n_points, d). The points between are interpolated where cells
        are inverted.
        """
        found = self.interpolated(u)
        if self.points is not None:
            for row in np.flatnonzero(self.inverted(found) == 0):
                one = slice(row, row + 1)
                found[one] = quadratic.balanced_between(self, found[one], f[one])
        return found

    def posed(self, load: Array, predicted: Array) -> tuple[Array, Array]:
        """Forces of loads on all points in N, and predictions at these in m, 0 where they are held.

        From (N, n_nodes or n_points, d) and (N, n_nodes, d) to (N, n_points, d) each.
        """
        f = self.forces_at_points(load)
        return f, self.at_points(np.where(self.free[: self.nodes], predicted, 0.0), f)

    def interpolated(self, u: Array) -> Array:
        """Displacements of all points in m, those between the nodes by interpolation."""
        return u if self.points is None else self.points.interpolated(u)

    def forces_at_points(self, f: Array) -> Array:
        """Forces on all points by those of a load, in N: (N, n_nodes or n_points, d) → latter."""
        if self.points is None:
            return f
        between = f[:, self.nodes :]
        if between.shape[1] == 0:
            between = np.zeros((len(f), self.points.between, f.shape[2]))
        return self.points.on_points(f[:, : self.nodes], between)

    def forces_at_nodes(self, f: Array) -> Array:
        """Forces on the nodes that do the work of those on all points, in N."""
        return f if self.points is None else self.points.on_nodes(f)

    def load_of(self, f: Array) -> Array:
        """The load that makes forces on all points: the inverse of `forces_at_points`."""
        return np.concatenate([self.forces_at_nodes(f), f[:, self.nodes :]], axis=1)

    def imperfection(self) -> Array:
        """Imperfection of the nodes, at all points: (n_points, d)."""
        return self.interpolated(imperfection((self.nodes, self.geometry.dimension)))

    def at_rest(self, f: Array) -> Array:
        """Forces on the undeformed body, those of following loads too: (N, n_nodes, d) in N."""
        if self.inertia is not None:
            f = f + self.inertia.forces(np.zeros(self.free.shape))
        return f if self.following is None else f + self.following.at_rest

    def inverted(self, u: Array) -> NDArray[np.int64]:
        """Number of inverted cells, (N,); a cell with a NaN counts as well."""
        return self.solid.compiled.inverted(u)

    def potential(self, u: Array, f: Array) -> Array:
        """Π(u) under dead forces in J, (N,); +∞ if a cell is inverted."""
        energy = self.solid.energy(torch.from_numpy(u)).numpy()
        potential: Array = energy - (u * f).sum((1, 2))
        if self.springs is not None:
            potential += [self.springs.potential(each) for each in u]
        if self.inertia is not None:
            potential += [self.inertia.potential(each) for each in u]
        potential[np.isnan(potential)] = np.inf
        return potential

    def out_of_balance(self, u: Array, f: Array) -> Array:
        """r(u) in N, (N, n_nodes, d); zero at clamped nodes."""
        require_time()
        r = self.solid.compiled.internal_forces(u) - self.external(u, f)
        r *= self.free
        return r

    def external(self, u: Array, f: Array) -> Array:
        """Forces f, and those of following loads, inertia and springs at a state, in N."""
        if self.following is not None:
            f = f + self._following_of(u).forces(u)
        if self.inertia is not None:
            f = f + [self.inertia.forces(each) for each in u]
        return f if self.springs is None else f + [self.springs.forces(each) for each in u]

    def inverse_at(
        self, u: Array, first_shift: float = FIRST_SHIFT
    ) -> tuple[Callable[[Array], Array], bool]:
        """K(u)⁻¹ of a single displacement (1, n_nodes, d), and whether K(u) is positive definite.

        It takes changes of the forces in N to those of the displacements in m, both (N, n_nodes,
        d). If K(u) is not, it is that of K(u) + τ K(0), with `first_shift` as the first τ; of K(u)
        itself under following loads.
        """
        tangent = self._tangent(u)
        if self.following is None:
            factor: Factor | None = self.layout.factor(tangent)
            stable = factor is not None
            factor = factor or self._shifted(tangent, first_shift)
        else:
            parts = [(points, k) for _, points, k in self._following_of(u).tangents(u)]
            factor, stable = self.layout.under_following(tangent, parts)
        return partial(self.solved_by, factor or self.undeformed), stable

    def response_at(self, u: Array) -> Callable[[Array], Array] | None:
        """K(u)⁻¹ of a single displacement (n_nodes, d); None if K is not positive definite."""
        inverse, stable = self.inverse_at(u[None])
        return inverse if stable else None

    def newton_step(
        self, u: Array, r: Array, first_shift: float = FIRST_SHIFT
    ) -> tuple[Array, bool]:
        """Return δ in m of a single displacement without inverted cells, (1, n_nodes, d).

        The second result is True if K(u) is positive definite.
        """
        inverse, stable = self.inverse_at(u, first_shift)
        return -inverse(r), stable

    def unstable_mode(self, u: Array) -> Array | None:
        """Lowest mode of a K(u) that is not positive definite, (1, n_nodes, d); None if it is.

        The mode v is that of least :math:`v^T K v` among all with :math:`v^T D v = 1`, with the
        diagonal D of K(0). Inverse iteration with :math:`K + c D`, which is positive definite,
        finds it from the body's imperfection, and with it which of v and −v.
        """
        layout = self.layout
        tangent = self._tangent(u)
        if layout.factor(tangent) is not None:
            return None
        metric, shift, factor = layout.diagonal(self._at_rest), LEAST_SHIFT, None
        while factor is None:
            factor = layout.factor(layout.on_springs(tangent, shift * metric))
            shift *= SHIFT_GROWTH
        found = self.imperfection().ravel()[self.layout.dofs]
        for _ in range(INVERSE_ITERATIONS):
            found = factor.solve(metric * found)
            found /= np.linalg.norm(found)
        mode = np.zeros((1, self._size))
        mode[0, self.layout.dofs] = found
        return mode.reshape(u.shape)

    def relaxed(self, u: Array, f: Array) -> Array:
        """Make the volumes of the cells right by a step, if they change as a whole.

        Where that leads to inverted cells, or the relaxed tangent is not positive definite,
        displacements stay as they are: (N, n_nodes, d) in m, without inverted cells → same, an
        array of its own.
        """
        found = u.copy()
        if not isinstance(self.solid, MeanDilationSolid | TaylorHoodSolid):
            return found
        r = self.out_of_balance(u, f)
        for row in range(len(u)):
            one = slice(row, row + 1)
            cells = self.solid.compiled.cell_tangents(u[one], relaxed=True)
            factor = self.layout.factor(self.layout.assembled(cells)[0] + self.of_masses)
            if factor is not None:
                trial = u[one] - self.solved_by(factor, r[one])
                found[one] = trial if self.inverted(trial)[0] == 0 else u[one]
        return found

    def newton_steps(self, u: Array, f: Array) -> NewtonSteps:
        """Return δ, and two simplified steps after it, at displacements without inverted cells."""
        steps, stable = np.zeros((3, *u.shape)), np.zeros(len(u), dtype=bool)
        for row in range(len(u)):
            one = slice(row, row + 1)
            inverse, stable[row] = self.inverse_at(u[one])
            at = u[one]
            for following in steps:
                following[one] = -inverse(self._finite_residual(at, f[one]))
                at = at + following[one]
        return NewtonSteps(steps[0], steps[1], steps[2], stable)

    def _finite_residual(self, u: Array, f: Array) -> Array:
        """r(u) in N, (N, n_nodes, d); NaN where a cell is inverted or a number is not finite."""
        residual = self.out_of_balance(u, f)
        residual[(self.inverted(u) > 0) | ~np.isfinite(residual).all((1, 2))] = np.nan
        return residual

    def linear_response(self, f: NDArray[Any]) -> NDArray[Any]:
        """K(0)⁻¹ f in m, (N, n_nodes, d), by a factor of the precision of f, which is kept."""
        require_time()
        return self.solved_by(self.rough if f.dtype == np.float32 else self.undeformed, f)

    def solved_by(self, factor: Factor, f: NDArray[Any]) -> NDArray[Any]:
        """K⁻¹ f in m by factors in the order of `layout`, in the precision of f in N.

        From (N, n_nodes, d) to the same.
        """
        forces = f.reshape(len(f), self._size)
        response = np.zeros_like(forces)
        response[:, self.layout.dofs] = factor.solve(forces[:, self.layout.dofs].T).T
        return response.reshape(f.shape)

    @cached_property
    def held_at_nodes(self) -> Equilibrium:
        """The same body, whose nodes are held."""
        held = ~self.free
        held[: self.nodes] = True
        return Equilibrium(replace(self.geometry, single=held), self.material)

    @cached_property
    def undeformed(self) -> SymmetricFactor:
        """The factor of K(0), in the order of `layout`; ValueError if K(0) is singular."""
        rest = np.zeros((1, *self.free.shape))
        tangent = self._tangent_of_solid(rest) if self.solid.projects else self._at_rest
        factor = self.layout.factor(tangent)
        if factor is None:
            raise ValueError("the stiffness of the body is singular; supports are missing")
        return factor

    @cached_property
    def rough(self) -> SymmetricFactor:
        """The factor of K(0) for forces in single precision."""
        return in_single_precision(self.undeformed, len(self.layout.dofs))

    def stiffness(self, dofs: NDArray[np.int64]) -> csr_array:
        """K(0) in N/m, (n_dofs, n_dofs), in some order of the degrees of freedom."""
        rows = np.zeros(self._size, np.int64)
        rows[self.layout.dofs] = np.arange(len(self.layout.dofs))
        return csr_array(self.layout.matrix(self._at_rest)[rows[dofs]][:, rows[dofs]])

    @cached_property
    def round_off(self) -> RoundOff:
        """Rounding errors of r."""
        diagonal = self.layout.diagonal(self._at_rest)
        return RoundOff.of(float(np.linalg.norm(diagonal)), diagonal.max(), self.cell_size)

    def _following_of(self, u: Array) -> FollowingLoads:
        """Following loads on every displacement."""
        assert self.following is not None
        return self.following[np.zeros(len(u), dtype=np.int64)]

    def _tangent(self, u: Array) -> Array:
        """K(u) of a single displacement without following loads, as `layout` assembles it."""
        tangent = self._tangent_of_solid(u)
        if self.springs is None:
            return tangent
        return self.layout.with_blocks(tangent, *self.springs.tangent(u[0]))

    def _tangent_of_solid(self, u: Array) -> Array:
        """K(u) of the elements, and what inertia adds."""
        found = self.layout.assembled(self.solid.compiled.cell_tangents(u))[0]
        if self.inertia is None:
            return found
        masses = self.inertia.masses
        if masses.viscosity is None:
            return np.asarray(found + self.of_masses)
        return np.asarray(found + self.layout.assembled(masses.tangents(u[0]))[0])

    @cached_property
    def of_masses(self) -> Array | float:
        """What inertia adds to K(0), as `layout` assembles it."""
        return 0.0

    @property
    def _at_rest(self) -> Array:
        """K(0)."""
        found = self.layout.assembled(self.solid.stiffness_at_rest())[0]
        return np.asarray(found + self.of_masses)

    def _shifted(self, tangent: Array, shift: float) -> Factor:
        """Factorise K(u) + τ K(0); K(0) if no τ is sufficient."""
        undeformed = self._at_rest
        while shift < 1 / EPSILON:
            factor = self.layout.factor(tangent + shift * undeformed)
            if factor is not None:
                return factor
            shift *= SHIFT_GROWTH
        return self.undeformed


def solid_kind(geometry: Geometry) -> type[Solid]:
    """Kind of the solid of a body."""
    if not geometry.mean_dilation:
        return Solid
    return TaylorHoodSolid if geometry.cell_type in LINEAR else MeanDilationSolid
