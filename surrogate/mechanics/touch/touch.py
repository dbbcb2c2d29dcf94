r"""Rigid tools that push a body: their forces, sought with predictions.

A surrogate predicts the displacement u of given nodal forces. The forces of a tool are sought:
normal to it, and such that no node of the surface enters it
(`surrogate.mechanics.touch.tool_contact`), by predictions around which the body is linear
(`surrogate.mechanics.touch.search`), frame by frame (`surrogate.mechanics.touch.frames`).

Where Newton's method finds the body, the contact is that of the factory
(`datagen.solver.tool_contact`). Its forces are found by the method of multipliers
(`surrogate.mechanics.equilibrium.tool_springs`): with springs to the tool, the potential energy has
a minimum, which Newton's method with a line search finds, past unstable equilibria
(`surrogate.mechanics.certify.correction`); the forces there are the next λ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.arguments import checked_arguments, read_only
from shared_schema.common.bodies.equilibrium import RELATIVE, ForceTolerance
from shared_schema.common.bodies.passing_walls import surrounds
from shared_schema.common.errors import WorkError
from shared_schema.common.units import SI, Units
from shared_schema.tools import Contact, Tool, contact_line, require_outside
from surrogate.mechanics.certify.correction import Correction, stable_state
from surrogate.mechanics.descent.driven_body import longest
from surrogate.mechanics.equilibrium.tool_springs import ToolSprings
from surrogate.mechanics.statics.prediction import Predictor
from surrogate.mechanics.touch.frames import Frames
from surrogate.mechanics.touch.loaded_body import Beside, LoadedBody, Predict
from surrogate.mechanics.touch.tool_contact import ToolContact

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

TOLERANCE = 1e-3  # of frames, of the largest displacement
INSIDE = 1e-3  # of the body's size: depth of a node that is an error
CLOSE = 1e-3  # of the same: movement of the last step towards a reaction
STIFFNESS = 100.0  # k over the largest stiffness of a node at rest
ROUNDS, SETTLED = 30, 1e-8  # of λ; its last change over the largest
FIRST, TIGHTER = 1e-6, 1e-2  # residual over the forces in the first round, and how it gets less
START = "contact with the tool"


@dataclass(frozen=True, repr=False)
class TouchFrame(Contact):
    """A body that is pushed by a tool: its forces, without the load beside them, and more.

    Attributes
    ----------
    displacement : array, (n_nodes, d)
        In m.
    apart : float
        Largest distance in m to the surface of the tool of a node that bears a force.
    predictions : int
        Number of predictions that it took.
    correction : Correction or None
        How the finite elements' equilibrium was found, if it is that (`Touch.correct`).
    units : Units
        Labels of the units of the case.
    """

    displacement: Array
    apart: float
    predictions: int
    correction: Correction | None = None
    units: Units = SI

    def __repr__(self) -> str:
        """Say what the tool does, and how far the body moves."""
        largest = self.units.written(longest(self.displacement))
        return f"TouchFrame({contact_line(self, self.units)}, largest displacement {largest})"


class Touch(Frames[ToolContact, TouchFrame]):
    """A body that tools push, frame by frame.

    >>> touch = Touch(model)                                       # doctest: +SKIP
    >>> frame = touch.move(Sphere((3, 1.2), 0.3))                  # doctest: +SKIP
    >>> frame.reaction                                             # in N  # doctest: +SKIP
    >>> touch.reaction(Sphere((3, 1.199), 0.3))                    # doctest: +SKIP

    Parameters
    ----------
    model : Surrogate, or Series
    tolerance : float
        Largest depth of a node, and distance of one that bears a force, over the largest
        displacement.
    corrected : bool, optional
        Whether the predictions of a frame are corrected by what they leave unbalanced; by default,
        all but those of load series.

    Attributes
    ----------
    surface : array of int, (n,)
        Nodes of the surface that can move.

    Raises
    ------
    InputError
        If the body's material is none of the learner's, or the tolerance is not positive.
    """

    def __init__(
        self, model: Predictor, tolerance: float = TOLERANCE, corrected: bool | None = None
    ) -> None:
        geometry = model.body.geometry
        on_surface = np.asarray(geometry.surface_nodes, np.int64)
        self.surface: Numbers = read_only(on_surface[geometry.free[on_surface].any(axis=1)])
        self._at_rest = geometry.coordinates[self.surface]
        d = geometry.dimension
        components = (self.surface[:, None] * d + np.arange(d)).ravel()
        super().__init__(model, components, tolerance, corrected)

    def let_go(self) -> None:
        """Forget the last frame."""
        self._begin_at_rest()

    @checked_arguments
    def move(
        self, tool: Tool, load: Beside = None, *, predict: Predict | None = None
    ) -> TouchFrame:
        """Predict the body with the tool where it is.

        Parameters
        ----------
        tool : Tool
            Of `shared_schema.tools`.
        load : array (n_nodes or n_points, d), str, sequence of str or CommandLoads, optional
            A load beside the forces of the tool, as that of `Surrogate.solve`: dead forces in N,
            or texts, also of pressures.
        predict : callable, optional
            The whole dead load in N to displacements in m, (n_nodes, d), with the pressures that
            act beside it; predictions of the surrogate by default.

        Raises
        ------
        InputError
            If the tool overlaps nodes that are held, is of another dimension or has the body all
            inside; or the load is wrong.
        WorkError
            If no forces are found.
        """
        return self._moved(*self._given(tool, load), predict)

    @checked_arguments
    def correct(self, tool: Tool, load: Beside = None) -> TouchFrame:
        """Find the equilibrium of the finite elements with the tool, beginning at the last frame.

        Raises
        ------
        InputError
            As `move`.
        WorkError
            If no stable equilibrium is found.
        """
        return self._corrected(*self._given(tool, load))[0]

    def _given(self, tool: Tool, load: Beside) -> tuple[ToolContact, LoadedBody]:
        """The contact with a tool, which can come to its place, and the body under the load."""
        require_outside(tool, self._model.body.geometry.coordinates, self._model.body.geometry.free)
        return ToolContact(tool, self._at_rest), LoadedBody.of(self._model, load)

    def _frame(self, predictions: int, correction: Correction | None = None) -> TouchFrame:
        """Describe what is shown."""
        assert self._condition is not None
        geometry, field = self._model.body.geometry, self._shown.field
        force = self._body.load(self._shown.force[None])[0]
        tool, x = self._condition.tool, geometry.coordinates + field
        gap = tool.gap(x)
        depth = max(0.0, -float(gap.min()))
        if depth > INSIDE * float(np.ptp(geometry.coordinates, axis=0).max()):
            self.let_go()
            raise WorkError(
                f"a node is {geometry.units.written(depth)} inside the tool, expected one that "
                "comes from outside of the body"
            )
        near = gap.min() < self._model.body.equilibrium.cell_size
        if near and not force.any() and self._surrounds(tool.inside, x):
            self.let_go()
            raise WorkError(
                "the tool is inside of the body, between its nodes, expected cells of at most a "
                "third of its radius"
            )
        return TouchFrame(
            displacement=field.copy(),
            force=force,
            penetration=depth,
            apart=float(np.abs(gap[force.any(axis=1)]).max(initial=0.0)),
            predictions=predictions,
            correction=correction,
            units=geometry.units,
        )

    def _surrounds(self, point: Array | None, x: Array) -> bool:
        """Whether a point, (d,), is inside of the body with nodes at x, (n_nodes, d)."""
        facets = self._model.body.geometry.surface_facets
        return point is not None and surrounds(x, facets, point)

    @checked_arguments
    def reaction(self, tool: Tool) -> Array:
        """Resultant in N, (d,), of a tool close to that of the last frame: no prediction is made.

        The body is linear around the last frame, by its compliance or, if that gives no forces, by
        a step of Newton's method.
        """
        contact, shown = ToolContact(tool, self._at_rest, settled=CLOSE), self._shown
        force = contact.forces(self._body, shown.u, shown.force) if self._holds else None
        if force is None:  # of a body that the contact holds
            return self._changed_reaction(tool)
        return np.asarray(force.reshape(self._at_rest.shape).sum(axis=0))

    @cached_property
    def _stiffness(self) -> Array:
        """Stiffness k of the springs in N/m, (n,)."""
        body = self._model.body.equilibrium
        layout, stiffness = body.layout, np.zeros(body.free.size)
        at_rest = layout.assembled(body.solid.stiffness_at_rest())[0]
        stiffness[layout.dofs] = layout.diagonal(at_rest)
        return STIFFNESS * stiffness.reshape(body.free.shape)[self.surface].max(axis=1)

    def _springs(self, contact: ToolContact, sizes: Array) -> ToolSprings:
        given = contact.tool, self.surface, self._at_rest, self._stiffness, sizes, contact.back
        return ToolSprings(*given)

    def _balanced(
        self, condition: ToolContact, loaded: LoadedBody, u: Array, force: Array
    ) -> tuple[Correction, Array]:
        """Equilibrium in which λ are the forces of the springs."""
        iterations, left, relative = 0, 0, FIRST
        f = loaded.equilibrium.forces_at_points(loaded.load.dead[None])
        sizes = np.linalg.norm(force.reshape(self._at_rest.shape), axis=1)
        springs = self._springs(condition, sizes)
        for _ in range(ROUNDS):
            body, tolerance = loaded.equilibrium.against(springs), ForceTolerance(relative=relative)
            found = stable_state(body, f, u, START, tolerance)
            iterations, left = iterations + found.iterations, left + found.left
            u, sizes = found.displacement[None], springs.sizes(found.displacement)
            change = float(np.abs(sizes - springs.multipliers).max(initial=0.0))
            springs = replace(springs, multipliers=sizes)
            settled = change <= SETTLED * float(sizes.max(initial=0.0))
            if settled and relative == RELATIVE:
                normal = condition.tool.normal(self._at_rest + u[0, self.surface])
                force = (sizes[:, None] * normal).ravel()
                return replace(found, iterations=iterations, left=left), force
            relative = max(TIGHTER * relative, RELATIVE)
        raise WorkError("the forces of the tool do not settle")

    def _changed_reaction(self, tool: Tool) -> Array:
        r"""Resultant in N, (d,), of a tool close to the last one, linear around its equilibrium.

        With the stiffness K of body and springs, the normals N of the nodes that bear forces, the
        changes :math:`λ \, δn` of these forces by the tool's motion, and the distances g,

        .. math:: λ ← λ - (N^T K^{-1} N)^{-1} (g + N^T K^{-1} λ \, δn) + k \, g.
        """
        last, loaded, force = self._condition, self._loaded, self._shown.force
        force = force.reshape(self._at_rest.shape)
        sizes, respond = np.linalg.norm(force, axis=1), None
        u, bear = loaded.at_points(self._shown.field, loaded.load.dead), np.flatnonzero(sizes)
        if last is not None and len(bear):
            respond = loaded.equilibrium.against(self._springs(last, sizes)).response_at(u)
        if last is None or respond is None:
            return np.asarray(force.sum(axis=0))
        x, every, nodes = (
            (self._at_rest + u[self.surface])[bear],
            np.arange(len(bear)),
            self.surface[bear],
        )
        n, right = last.tool.normal(x), np.zeros((len(bear) + 1, *u.shape))
        right[every, nodes] = n
        right[-1, nodes] = sizes[bear, None] * (tool.normal(x) - n)
        moved = respond(right)[:, nodes]
        along, gap = np.einsum("abd,bd->ba", moved, n), tool.gap(x)
        found = -np.linalg.solve(along[:, :-1], gap + along[:, -1])
        after = np.maximum(sizes[bear] + found + self._stiffness[bear] * gap, 0.0)
        shift = np.tensordot(np.append(found, 1.0), moved, 1)
        return np.asarray(after @ tool.normal(x + shift))
