"""Motion on a page: masses of the body, and the time steps of its first vibration.

The page takes the steps of `surrogate.Session`, by the same scheme
(``web/src/mechanics/motion.ts``).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from shared_schema.common.errors import InputError
from shared_schema.materials import as_tuple
from shared_schema.motion import Scheme, TimeSettings, densities_of_cells
from surrogate.mechanics.descent.aim import require_positive
from surrogate.mechanics.equilibrium.inertia import Masses
from surrogate.mechanics.motion.moving_body import MovingBody
from surrogate.mechanics.statics.body import Body
from surrogate.page.body import Arrays, below, sparse_rows

FRAME = 1 / 60  # s of a screen: the longest time step
STEPS = 50  # of the first vibration, at least


def motion_data(body: Body, density: float | None = None) -> tuple[dict[str, Any], Arrays]:
    """Describe what a body needs to move, with its materials' density or one in kg/m³.

    Returns
    -------
    text : dict
        ``motion``: step h in s and coefficients of the scheme, frequency ω of the first vibration
        in 1/s, its damping ratio by the case. Nothing for a body without a density, or with
        actuators.
    arrays : dict
        ``motion/mass``, the mass matrix of a component in kg by rows.

    Raises
    ------
    InputError
        If a density is given for a body with actuators.
    """
    geometry, equilibrium = body.geometry, body.equilibrium
    require_positive("density", density)
    if geometry.actuators is not None and density is not None:
        raise InputError("density: expected none for a page with actuators, which has no motion")
    known = [density or each.density for each in as_tuple(body.material)]
    if geometry.actuators is not None or None in known:
        return {}, {}
    of_cells = np.full(len(geometry.cells), density)
    if density is None:
        of_cells = densities_of_cells(body.material, geometry.parts, len(of_cells))
    settings = TimeSettings(**{"step": FRAME, "duration": FRAME} | (body.case.get("time") or {}))
    of = equilibrium.solid, equilibrium.geometry, settings.rule, of_cells
    masses = Masses.of(*of, lumped=settings.mass == "lumped")
    frequency = MovingBody(equilibrium, masses).frequency
    step = min(FRAME, 2 * np.pi / frequency / STEPS)
    scheme = Scheme.generalised_alpha(step, settings.dissipation)
    text = {
        "step": step,
        "beta": scheme.beta,
        "gamma": scheme.gamma,
        "fresh": (1 - scheme.alpha_m) / (1 - scheme.alpha_f),
        "former": scheme.alpha_m / (1 - scheme.alpha_f),
        "carried": scheme.carried,
        "frequency": frequency,
        "damping": settings.damping.mass / (2 * frequency),
    }
    return {"motion": text}, below("motion/mass", sparse_rows(masses.matrix))
