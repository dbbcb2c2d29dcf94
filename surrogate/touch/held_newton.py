r"""Equilibrium of a body that is held at places, by Newton's method: no prediction is made.

Held components are supports at given displacements. From a state u that is known, they move by δ,
and the rest of the body with them to first order,

.. math:: u + δ - K^{-1} K(u) \, δ

with the inverse of K at free components; Newton's method with a line search goes on from there
(`surrogate.certify.correction`). A step that fails is halved. The grips may hold a body that their
forces alone would not. Pressures, under which no energy tells the right step, grow with the
displacement where the body is at rest, or does not go on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import WorkError
from surrogate.certify.correction import Correction, stable_state
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.touch.body import LoadedBody
from surrogate.touch.halved_steps import halved_steps

Array = NDArray[np.float64]
START = "last state of the grips"
SMALL = 1e-6  # of an edge of a cell: displacement whose difference is taken


class HeldNewton:
    """A body that is held at some components.

    Parameters
    ----------
    equilibrium : Equilibrium
        Of the body without grips.
    held : array of bool, (n_points, d)
        Components that the grips hold.
    """

    def __init__(self, equilibrium: Equilibrium, held: NDArray[np.bool_]) -> None:
        geometry, materials = equilibrium.geometry, equilibrium.solid.materials
        fixed = ~equilibrium.free | held
        supports = replace(geometry, single=fixed, clamped=np.asarray(fixed.all(axis=1)))
        self._body = Equilibrium(supports, materials[0] if len(materials) == 1 else materials)
        self._held = held

    def find(self, wanted: Array, loaded: LoadedBody, field: Array) -> tuple[Correction, Array]:
        """Find the equilibrium and the forces of the grips.

        Parameters
        ----------
        wanted : array, (n_points, d)
            Displacement of the held components in m.
        loaded : LoadedBody
            The body under the load beside the grips.
        field : array, (n_nodes, d)
            A displacement in m to begin from.

        Returns
        -------
        correction : Correction
        force : array, (n_points, d)
            Forces of the grips in N.

        Raises
        ------
        WorkError
            If no stable equilibrium is found.
        """
        u, presses = loaded.at_points(field, loaded.dead), loaded.pressure is not None
        try:
            found = self._on_the_way(wanted, loaded, u, presses and not field.any())
        except WorkError:
            if not (presses and field.any()):
                raise
            found = self._on_the_way(wanted, loaded, np.zeros_like(u), grows=True)
        f = loaded.equilibrium.forces_at_points(loaded.dead[None])
        out = loaded.equilibrium.out_of_balance(found.displacement[None], f)[0]
        at_nodes = found.displacement[: len(field)]
        return replace(found, displacement=at_nodes), np.where(self._held, out, 0.0)

    def _on_the_way(
        self, wanted: Array, loaded: LoadedBody, begin: Array, grows: bool
    ) -> Correction:
        """Move the held components from a state, (n_points, d); the load may grow with them."""
        f, first = loaded.equilibrium.forces_at_points(loaded.dead[None]), begin * self._held

        def go(share: float, last: Correction) -> Correction:
            part, u = share if grows else 1.0, last.displacement
            body = self._body
            if loaded.pressure is not None:
                body = body.under(loaded.pressure.scaled(part))
            moved = np.where(self._held, first + share * (wanted - first) - u, 0.0)
            lifted = self._lifted(body, u[None], part * f, moved[None])
            found = stable_state(body, part * f, lifted, START)
            return replace(found, iterations=last.iterations + found.iterations)

        return halved_steps(
            go,
            Correction(begin, START, 0, 0.0),
            lambda share: (
                f"no equilibrium of the held body is found beyond {share:.0%} of the displacement"
            ),
        )

    def _lifted(self, body: Equilibrium, u: Array, f: Array, moved: Array) -> Array:
        """Move held components, and the rest with them to first order: (1, n_points, d)."""
        largest = float(np.abs(moved).max())
        if largest == 0:
            return u
        small = SMALL * body.cell_size / largest
        change = body.out_of_balance(u + small * moved, f) - body.out_of_balance(u, f)
        response = body.response_at(u[0]) or body.linear_response
        lifted = u + moved - response(change / small)
        if body.inverted(lifted)[0]:
            raise WorkError("cells are inverted")
        return np.asarray(lifted)
