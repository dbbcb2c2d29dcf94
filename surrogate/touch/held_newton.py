r"""Equilibrium of a body that is held at places, by Newton's method: no prediction is made.

Held components are supports at given displacements. From a state u that is known, they move by δ,
and the rest of the body with them to first order,

.. math:: u + δ - K^{-1} K(u) \, δ

with the inverse of K at free components; Newton's method with a line search goes on from there
(`surrogate.certify.correction`). A step that fails is halved. The grips may hold a body that their
forces alone would not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import WorkError
from surrogate.certify.correction import Correction, iterated
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.touch.halved_steps import halved_steps

Array = NDArray[np.float64]
START = "last state of the grips"
SMALL = 1e-6  # of an edge of a cell: displacement whose difference is taken


class HeldNewton:
    """A body that is held at some components.

    Parameters
    ----------
    equilibrium : Equilibrium
        Of the body without grips, whose elements have no points between the nodes.
    held : array of bool, (n_nodes, d)
        Components that the grips hold.
    """

    def __init__(self, equilibrium: Equilibrium, held: NDArray[np.bool_]) -> None:
        geometry, materials = equilibrium.geometry, equilibrium.solid.materials
        fixed = ~equilibrium.free | held
        self._free = equilibrium
        supports = replace(geometry, single=fixed, clamped=np.asarray(fixed.all(axis=1)))
        self._body = Equilibrium(supports, materials[0] if len(materials) == 1 else materials)
        self._held = held

    def find(self, wanted: Array, load: Array, field: Array) -> tuple[Correction, Array]:
        """Find the equilibrium and the forces of the grips.

        Parameters
        ----------
        wanted, load, field : array, (n_nodes, d)
            Displacement of the held components in m, nodal forces beside those of the grips in N,
            and a displacement in m to begin from.

        Returns
        -------
        correction : Correction
        force : array, (n_nodes, d)
            Forces of the grips in N.

        Raises
        ------
        WorkError
            If no stable equilibrium is found.
        """
        f, begin, found = load[None], np.where(self._held, field, 0.0), list[Correction]()

        def go(share: float) -> None:
            u = found[-1].displacement if found else field
            moved = np.where(self._held, begin + share * (wanted - begin) - u, 0.0)
            lifted = self._lifted(u[None], f, moved[None])
            found.append(iterated(self._body, f, lifted, START))

        halved_steps(
            go,
            lambda share: (
                f"no equilibrium of the held body is found beyond {share:.0%} of the displacement"
            ),
        )
        out = self._free.out_of_balance(found[-1].displacement[None], f)[0]
        iterations = sum(each.iterations for each in found)
        return replace(found[-1], iterations=iterations), np.where(self._held, out, 0.0)

    def _lifted(self, u: Array, f: Array, moved: Array) -> Array:
        """Move held components, and the rest with them to first order: (1, n_nodes, d)."""
        body, largest = self._body, float(np.abs(moved).max())
        if largest == 0:
            return u
        small = SMALL * body.cell_size / largest
        change = body.out_of_balance(u + small * moved, f) - body.out_of_balance(u, f)
        response = body.response_at(u[0]) or body.linear_response
        lifted = u + moved - response(change / small)
        if body.inverted(lifted)[0]:
            raise WorkError("cells are inverted")
        return np.asarray(lifted)
