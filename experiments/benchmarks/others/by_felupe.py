"""Equilibria by FElupe (https://felupe.readthedocs.io)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import felupe
import numpy as np
from measured import measured
from tensortrax.math import log, sqrt, trace
from tensortrax.math.linalg import det

STEPS = 5


def energy(c: Any, mu: float, lam: float) -> Any:
    """ψ = μ/2 (tr C − 3 − 2 ln J) + λ/4 (J² − 1 − 2 ln J)."""
    j = sqrt(det(c))
    return mu / 2 * (trace(c) - 3 - 2 * log(j)) + lam / 4 * (j**2 - 1 - 2 * log(j))


def prepared(p: dict[str, Any]) -> Callable[..., Any]:
    """Return what solves one load."""
    d, kind = p["x"].shape[1], str(p["type"])
    regions = {
        "quad": felupe.RegionQuad,
        "tetra": felupe.RegionTetra,
        "hexahedron": felupe.RegionHexahedron,
    }
    region = regions[kind](felupe.Mesh(p["x"], p["cells"], kind))
    mu = p["young"] / 2 / (1 + p["poisson"])
    lam = 2 * mu * p["poisson"] / (1 - 2 * p["poisson"])
    law = felupe.Hyperelastic(energy, mu=mu, lam=lam)
    if "pressed" in p:
        law = felupe.ThreeFieldVariation(law)
        inside = np.isin(np.arange(len(p["x"])), p["pressed"])
        surface = felupe.RegionHexahedronBoundary(region.mesh, mask=inside)

    def solve(force: Any, pressure: float = 0.0) -> Any:
        if "pressed" in p:
            field = felupe.FieldsMixed(region, n=3)
        elif d == 2:
            field = felupe.FieldContainer([felupe.FieldPlaneStrain(region, dim=2)])
        else:
            field = felupe.FieldContainer([felupe.Field(region, dim=3)])
        body, parts = felupe.SolidBody(law, field), np.linspace(0, 1, STEPS + 1)[1:]
        load = felupe.PointLoad(field, np.arange(len(force)), values=force)
        items, ramp = [body, load], {load: [force * part for part in parts]}
        if "pressed" in p:
            pressed = felupe.FieldContainer([felupe.Field(surface, dim=3)])
            items.append(felupe.SolidBodyPressure(pressed))
            ramp[items[-1]] = list(pressure * parts)
        held = {"held": felupe.Boundary(field[0], mask=p["held"].all(axis=1))}
        felupe.Job([felupe.Step(items, ramp=ramp, boundaries=held)]).evaluate(verbose=0, tol=1e-8)
        return field[0].values.copy()

    return solve


measured(prepared)
