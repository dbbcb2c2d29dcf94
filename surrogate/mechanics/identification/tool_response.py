"""Displacement fields of a body that a tool pushes, by the place of the tool."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError, WorkError
from shared_schema.tools import Displaced
from surrogate.mechanics.identification.responses import Response
from surrogate.mechanics.statics.load import Load
from surrogate.mechanics.touch.loaded_body import LoadedBody
from surrogate.mechanics.touch.touch import Touch, TouchFrame

Array = NDArray[np.float64]
CONTACT = 1e-5  # tolerance of the contact: differences are not to see it
DIFFERENCE = 1e-2  # of a change that matters


class ToolResponse(Response):
    """Predictions with the tool at θ m from where it is given, and their forward differences.

    Parameters
    ----------
    touch : Touch
        Of the body, with the tolerance `CONTACT`; fits that follow one another share it.
    given
        As `Response` takes them.
    """

    difference = DIFFERENCE

    def __init__(self, touch: Touch, *given: Any) -> None:
        super().__init__(*given)
        self._touch = touch

    def field(self, theta: Array) -> Array:
        """u(θ) in m, or of N sets of parameters; NaN where no contact is found."""
        if theta.ndim == 2:
            return np.array([self.field(one) for one in theta])
        try:
            return self._frame(theta).displacement
        except (InputError, WorkError):  # the tool may not be there
            return np.full(self.predictor.body.geometry.coordinates.shape, np.nan)

    def load(self, theta: Array) -> Load:
        """Forces of the tool, and what is known."""
        dead = self._loaded.with_forces(self._frame(theta).force)
        return Load(dead, self.unknowns.pressures)

    def _frame(self, theta: Array) -> TouchFrame:
        assert self.unknowns.tool is not None
        tool = Displaced(self.unknowns.tool, tuple(map(float, theta)))
        return self._touch.move(tool, self._loaded)

    @property
    def _loaded(self) -> LoadedBody:
        load = Load(self.unknowns.known, self.unknowns.pressures)
        return LoadedBody(self.predictor, load)
