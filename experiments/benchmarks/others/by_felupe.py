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


def prepared(p: dict[str, Any]) -> Callable[[Any], Any]:
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

    def solve(force: Any) -> Any:
        u = felupe.FieldPlaneStrain(region, dim=2) if d == 2 else felupe.Field(region, dim=3)
        field = felupe.FieldContainer([u])
        body = felupe.SolidBody(felupe.Hyperelastic(energy, mu=mu, lam=lam), field)
        load = felupe.PointLoad(field, np.arange(len(force)), values=force)
        ramp = {load: [force * part for part in np.linspace(0, 1, STEPS + 1)[1:]]}
        held = {"held": felupe.Boundary(u, mask=p["held"].all(axis=1))}
        step = felupe.Step([body, load], ramp=ramp, boundaries=held)
        felupe.Job([step]).evaluate(verbose=0, tol=1e-8)
        return u.values.copy()

    return solve


measured(prepared)
