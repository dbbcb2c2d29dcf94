r"""Correction of predictions from frame to frame, by the forces that they leave unbalanced.

Frames show a prediction ũ of the forces f and a shift δ, :math:`u = ũ(f) + δ`. In each of them,
once the forces are found roughly,

.. math:: δ ← δ - P(u) \, r(u), \qquad r(u) = f_{int}(u) - f, \qquad P(u) ≈ K(u)^{-1},

one step of defect correction (Böhmer, Hemker and Stetter, *The defect correction approach*, 1984),
with the carried compliance P (`surrogate.descent.carried_compliance`); then the forces are found
with the new shift. Frames that follow one another are alike, and so are the errors of their
predictions: what is left is a part of what these change in one frame, and a body that is kept still
comes to its equilibrium.

A step is at most as long as the motion since the last one, or as the last one itself. P is positive
definite, so that a body which its contact alone keeps from snapping is not pushed away by it; where
a body has stiffened so much that P is too long, steps do not grow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surrogate.descent.descent import longest
from surrogate.touch.body import Body

Array = NDArray[np.float64]
ROUGHLY = 1e-2  # of a search for forces: part of the displacement, before a correction
FARTHEST = 1.0  # of the largest displacement: a longer shift is given up


class DefectCorrection:
    """The shift of one sequence of frames.

    Parameters
    ----------
    model : Body
    wanted : bool, optional
        Whether there is one; by default, of all predictions but those of load series.

    Attributes
    ----------
    wanted : bool
    shift : array, (n_nodes, d)
        δ in m.
    """

    shift: Array

    def __init__(self, model: Body, wanted: bool | None = None) -> None:
        self._model, self.wanted = model, not model.has_series if wanted is None else wanted
        self.forget()

    def forget(self) -> None:
        """Begin at rest, with no shift."""
        self.shift = np.zeros(self._model.geometry.coordinates.shape)
        self._field, self._step = self.shift, 0.0

    def corrected(self, predicted: Array, force: Array) -> Array:
        """Return a prediction with the shift, in m; a body without forces is at rest."""
        return predicted + self.shift if force.any() else predicted

    def improve(self, field: Array, force: Array) -> Array:
        """Correct the shift, and return its change in m, (n_nodes, d).

        Parameters
        ----------
        field, force : array, (n_nodes, d)
            Displacement in m that is shown, and all forces in N under which it is.
        """
        if not force.any():
            self.forget()  # and what is shown has no shift
            return self.shift
        before, body, equilibrium = self.shift, self._model.driven_body, self._model.equilibrium
        points = equilibrium.forces_at_points(force[None])[0]
        u = equilibrium.at_points(field[None])[0]
        state = body.state(u, points)
        if state is not None:
            step = -body.compliance.at(u)(state.r)[: equilibrium.nodes]
            allowed, length = max(longest(field - self._field), self._step), longest(step)
            if length > allowed:
                step, length = step * (allowed / length), allowed
            if longest(before + step) <= FARTHEST * longest(field):
                self.shift, self._field, self._step = before + step, field, length
                return step
        self.forget()
        return -before
