"""The page's mechanics, run by node: bodies are asked for what Python computes too."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.following_loads import FollowingLoad
from surrogate.mechanics.actuation.actuation import Actuation
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.statics.body import Body
from surrogate.page.body import Arrays, below, body_data, following_data
from surrogate.page.page_actuators import actuator_data
from surrogate.page.page_motion import motion_data

Array = NDArray[np.float64]
WEB = Path(__file__).parents[3] / "surrogate" / "page" / "web"
SOURCE = Path(__file__).with_name("mechanics_in_node.ts")


class PageInNode:
    """The bundled mechanics.

    Parameters
    ----------
    folder : Path
        Where the bundle is written.
    """

    def __init__(self, folder: Path) -> None:
        self.script = folder / "mechanics.mjs"
        esbuild = [str(WEB / "node_modules/.bin/esbuild"), str(SOURCE), "--bundle", "--format=esm"]
        out = [f"--outfile={self.script}", "--log-level=error", "--platform=node"]
        subprocess.run([*esbuild, *out], check=True)

    def __call__(
        self,
        equilibrium: Equilibrium,
        asks: list[dict[str, Any]],
        following: Sequence[FollowingLoad] = (),
        actuation: Actuation | None = None,
        moving: Body | None = None,
    ) -> list[Any]:
        """Answer questions: `kind`, `force` in N, `pressures` in Pa, and what the kind needs."""
        text, arrays = body_data(equilibrium)
        of_units, units = following_data(following, equilibrium.geometry.dimension)
        of_actuators, actuators = dict[str, Any](), Arrays()
        if actuation is not None:
            found, own = actuator_data(actuation)
            of_actuators, actuators = {"actuation": found}, below("actuation", own)
        of_motion, masses = ({}, {}) if moving is None else motion_data(moving)
        request = {
            "text": text | of_units | of_actuators | of_motion,
            "arrays": {
                name: {"type": array.dtype.name, "values": array.ravel().tolist()}
                for name, array in (arrays | units | actuators | masses).items()
            },
            "asks": [
                {"pressures": []}
                | {k: numbers(v) if isinstance(v, np.ndarray) else v for k, v in ask.items()}
                for ask in asks
            ],
        }
        done = subprocess.run(
            ["node", str(self.script)],
            input=json.dumps(request),
            capture_output=True,
            text=True,
            check=True,
        )
        answers: list[Any] = json.loads(done.stdout)
        return answers


def numbers(field: Array) -> list[float | None]:
    """Values of a field; null for NaN."""
    return [None if np.isnan(value) else float(value) for value in field.ravel()]
