r"""Points between the nodes of a body, whose predictions are those of its nodes.

The *points* of the elements are the nodes of the mesh, that is the corners :math:`u_c` of the
cells, and the points between them, :math:`u_m`. In any state, the points between the nodes are
where they are in equilibrium with the load: with the forces g on them,

.. math:: u_m(u_c) = \arg\min_{u_m} E(u_c, u_m) - g · u_m.

Newton's method with a line search finds them from their linear interpolation, in `incompressible`
triangles and tetrahedra after a step that makes the volumes right. So a displacement of
the nodes is one of all points, and the error of a prediction is not that of the interpolation: at
the nodes of an equilibrium, the points are those of the equilibrium itself. Under pressures on them
there is no such energy: every step is one under the pressures' forces as they are.

A *load* is one array of the nodal forces f, and after these, if there are any, the forces g of the
points between the nodes (`shared_schema.common.bodies.points_between`). f does the work
of all forces in displacements that are linear in the cells. Without g, forces act at the nodes
alone.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.reference_cells import NAMES
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.newton_steps import norms

if TYPE_CHECKING:
    from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium

Array = NDArray[np.float64]
ITERATIONS, HALVINGS = 20, 20  # of the points between the nodes
SMALL = 1e-9  # of the displacement: a step after which the next one is a rounding error
ROUNDED = 1e-13  # of the size of a cell: a step of rounding errors


def balanced_between(body: Equilibrium, u: Array, f: Array) -> Array:
    """Move the points between the nodes to their equilibrium, (1, n_points, d)."""
    held, following = body.held_at_nodes, body.following
    between = following is not None and following.points is not None
    pressed = held.under(following) if between and following is not None else None
    u = held.relaxed(u, f)
    for _ in range(ITERATIONS):
        lowered = lower(held, u, f if pressed is None else pressed.external(u, f))
        if lowered is None:
            break
        size, u = norms(lowered - u), lowered
        if size <= np.maximum(SMALL * norms(u), ROUNDED * body.cell_size):
            break
    return u


def lower(body: Equilibrium, u: Array, f: Array) -> Array | None:
    """Newton step under dead forces, halved until Π is no higher: the next state.

    All arrays are (1, n_points, d); None if there is no such step.
    """
    step, _ = body.newton_step(u, body.out_of_balance(u, f))
    potential = body.potential(u, f)
    for halving in range(HALVINGS):
        trial = u + 0.5**halving * step
        if body.potential(trial, f) <= potential + body.rounding:
            return trial
    return None


def on_points(geometry: Geometry) -> Geometry:
    """Geometry of all points of quadratic elements; grid and groups stay those of the nodes."""
    points = geometry.points_between
    held = points.held(geometry.held)
    return replace(
        geometry,
        coordinates=points.interpolated(geometry.coordinates),
        cells=points.cells,
        cell_type=NAMES[geometry.cell_type],
        clamped=np.asarray(held.all(axis=1)),
        single=held,
    )
