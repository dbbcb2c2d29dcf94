"""Actuators on a page: their sliders, and the modes in which it finds what they do.

The page solves what `surrogate.mechanics.actuation` solves, in the same modes, by the same cells
(``web/src/mechanics/actuated_modes.ts``).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from shared_schema.actuators import KINDS, UNITS, Control
from shared_schema.common.bodies.following_loads import PressedSurface
from surrogate.mechanics.actuation.actuation import Actuation
from surrogate.page.body import Arrays, below, elements_data
from surrogate.page.surface import triangulated


def actuator_data(model: Actuation) -> tuple[dict[str, Any], Arrays]:
    """Describe the actuators of a body, and its modes.

    Returns
    -------
    text : dict
        ``controls``, what is given of all loads that follow the body (pressures of surfaces come
        first), ``elements`` of the sampled cells, ``names`` and numbers of the sliders.
    arrays : dict
        ``modes`` at all points and, ``ofElements``, at those of the sampled cells, (n_modes,
        n_points, d) each; facets of ``chambers`` by nodes, (n, d).
    """
    reduced, geometry = model.reduced, model.body.geometry
    mesh, nodes = reduced.equilibrium.geometry, len(geometry.coordinates)
    surfaces = (Control("pressure", 0.0, rest=1.0),) * len(geometry.surfaces)
    controls = model.controls_of(model.limits({})[0])
    known = reduced.elements, mesh.coordinates[reduced.points], mesh.cell_type
    elements, of_elements = elements_data(*known)
    text = {
        "controls": [
            {"kind": control.kind, "rest": control.rest, "ambient": control.ambient}
            for control in (*surfaces, *controls)
        ],
        "elements": elements,
        "sliders": sliders(model),
        "size": model.size,
    }
    facets = [load.facets for load in reduced.units if isinstance(load, PressedSurface)]
    corners = [each[:, (each < nodes).all(axis=0)] for each in facets]
    drawn = corners if geometry.dimension == 2 else [triangulated(each) for each in corners]
    arrays: Arrays = {
        "modes": reduced.modes,
        "ofElements": reduced.modes[:, reduced.points],
        "chambers": np.concatenate([*drawn, np.empty((0, geometry.dimension))]).astype(np.int32),
    }
    return text, arrays | below("elements", of_elements)


def sliders(model: Actuation) -> list[dict[str, Any]]:
    """Name, unit, range, start and readings (name and unit) of each actuator.

    The ranges are those of the case, and hold what is given at rest.
    """
    found, (low, high), named = [], model.limits({}), model.body.units.named
    each = zip(model.names, model.controls_of(low), low, high, strict=True)
    for name, control, least, most in each:
        unit, of = KINDS[control.kind]
        rest = control.at_rest
        found.append(
            {
                "name": name,
                "kind": control.kind,
                "unit": named(unit),
                "low": min(least, rest),
                "high": max(most, rest),
                "rest": rest,
                "readings": [[reading, named(label)] for reading, label in UNITS[of]],
            }
        )
    return found
