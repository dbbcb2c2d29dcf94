"""Bodies in motion by Newton (https://github.com/newton-physics/newton), in its Neo-Hookean law."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import newton
import numpy as np
import warp
from measured import clock, measured, tetrahedra

STEP, STILL, PATIENCE = 1 / 600, 1e-3, 10.0  # s, speed over displacement in 1/s, s


def prepared(p: dict[str, Any]) -> Callable[[Any], Any]:
    """Return what waits until the body rests under one load."""
    warp.set_device("cpu")
    mu = float(p["young"] / 2 / (1 + p["poisson"]))
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_soft_mesh(
        pos=warp.vec3(0.0, 0.0, 0.0),
        rot=warp.quat_identity(),
        vel=warp.vec3(0.0, 0.0, 0.0),
        scale=1.0,
        vertices=[warp.vec3(*point) for point in p["x"]],
        indices=tetrahedra(p["cells"]).ravel().tolist(),
        density=1000.0 if p["young"] > 1000 else 10.0,
        k_mu=mu,
        k_lambda=2 * mu * float(p["poisson"] / (1 - 2 * p["poisson"])),
        k_damp=0.01 * mu,
    )
    for node in np.flatnonzero(p["held"].all(axis=1)):
        builder.particle_mass[node] = 0.0
    builder.color()
    model = builder.finalize()
    solver = newton.solvers.SolverVBD(model, iterations=10, particle_enable_tile_solve=False)

    def solve(force: Any) -> Any:
        now, then, control = model.state(), model.state(), model.control()
        load, began = warp.array(force, dtype=warp.vec3), clock()
        u, steps = np.zeros_like(force), 0
        while clock() - began < PATIENCE:
            warp.copy(now.particle_f, load)
            solver.step(now, then, control, None, STEP)
            now, then, steps = then, now, steps + 1
            u, speed = now.particle_q.numpy() - p["x"], np.abs(now.particle_qd.numpy()).max()
            if steps > 100 and speed < STILL * np.abs(u).max():
                break
        return u

    return solve


measured(prepared)
