"""Bodies at rest by MuJoCo (https://mujoco.org): a flex of St. Venant and Kirchhoff's material."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from measured import clock, measured, tetrahedra

STEP, STILL, PATIENCE = 0.1, 1e-3, 20.0  # s, speed over displacement in 1/s, s


def text(values: Any) -> str:
    """Write numbers as an attribute."""
    return " ".join(str(value) for value in np.ravel(values))


def prepared(p: dict[str, Any]) -> Callable[[Any], Any]:
    """Return what waits until the body rests under one load."""
    young, poisson, held = p["young"], p["poisson"], np.flatnonzero(p["held"].all(axis=1))
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
        <option timestep="{STEP}" gravity="0 0 0" integrator="discrete"/><size memory="1G"/>
        <worldbody><flexcomp name="body" type="direct" dim="3" mass="1" radius="1e-3"
            point="{text(p["x"])}" element="{text(tetrahedra(p["cells"]))}">
        <elasticity young="{young}" poisson="{poisson}" damping="0.1"/>
        <contact selfcollide="none" contype="0" conaffinity="0"/><pin id="{text(held)}"/>
        </flexcomp></worldbody></mujoco>""")

    def solve(force: Any) -> Any:
        data, began, u = mujoco.MjData(model), clock(), np.zeros_like(force)
        moving = model.flex_vertbodyid > 0
        data.xfrc_applied[model.flex_vertbodyid[moving], :3] = force[moving]
        while clock() - began < PATIENCE:
            mujoco.mj_step(model, data)
            u = data.flexvert_xpos - p["x"]
            if data.time > 5 * STEP and np.abs(data.qvel).max() < STILL * np.abs(u).max():
                break
        return u

    return solve


measured(prepared)
