"""Bodies in motion: what steps take, what they leave, and how far trajectories go apart.

A body is let go from under a load, pulled by a load that varies, and hit by a sphere, at 60 steps a
second. Its density is such that it swings about once a second: the 3D beam of 4 m and 500 Pa moves
as one of 0.2 m, 20 kPa and 1000 kg/m³. Steps within the tolerance are compared with those of
converged steps, and each one with the equilibrium of its own, by its certificate.

    python -m experiments benchmark motion beam3d_any

writes its record and its page.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

import surrogate
from experiments.benchmarks.benchmark import Results
from experiments.benchmarks.directions import rounded
from experiments.framework.report import table_of
from shared_schema.common import Parser
from shared_schema.tools import Sphere, Tool
from surrogate.mechanics.statics.load import Load

Array = NDArray[np.float64]
STEP, STEPS, EVERY = 1 / 60, 45, 9  # s; steps of a motion; steps of one certificate
EXACT = 1e-9  # tolerance of converged steps
MOTIONS = ("let go", "pulled", "hit")
PERIOD = 0.75  # s, of a load
SPREAD = 0.5  # of the smallest side: radius within which it acts


class Motion:
    """One motion of a body.

    Parameters
    ----------
    model : Surrogate
    kind : str
    density : float
        In kg/m³.
    force : float
        At the tip, downwards in N.
    """

    def __init__(self, model: surrogate.Surrogate, kind: str, density: float, force: float) -> None:
        self.model, self.kind, self.density = model, kind, density
        geometry = model.geometry
        self.side = float(np.ptp(geometry.coordinates, axis=0).min())
        self.tip, self.top = geometry.coordinates[geometry.tip], geometry.coordinates[:, -1].max()
        place = ",".join(repr(float(x)) for x in (*self.tip, SPREAD * self.side))
        across = ",".join("0" * (geometry.dimension - 1))
        self.text = f"{place}:{across},{-force}"
        self.load = Load.of(geometry, self.text)

    def session(self, tolerance: float) -> surrogate.Session:
        """The body at its begin."""
        session = surrogate.Session(self.model, density=self.density, tolerance=tolerance)
        session.begin(self.load if self.kind == "let go" else None)
        return session

    def factor(self, number: int) -> float:
        """Factor on the load of a body that is let go, or pulled, at the end of a step."""
        pulled = self.kind == "pulled"
        return float(np.sin(2 * np.pi * number * STEP / PERIOD)) if pulled else 0.0

    def given(self, number: int) -> tuple[Load | None, Tool | None]:
        """What acts at the end of a step."""
        at = number * STEP
        if self.kind == "let go":
            return None, None
        if self.kind == "pulled":
            return self.load.part(self.factor(number)), None
        depth = 0.5 * self.side * np.sin(np.pi * min(at / PERIOD, 1.0))
        radius, centre = 0.3 * self.side, self.tip.copy()
        centre[0] -= radius
        centre[-1] = self.top + radius - depth
        return None, Sphere(tuple(centre), radius)

    def frames(self, tolerance: float, every: int = 0) -> Iterator[tuple[surrogate.Frame, float]]:
        """Yield frames and the seconds of the processor; every so many are certified."""
        session = self.session(tolerance)
        for number in range(1, STEPS + 1):
            load, tool = self.given(number)
            certify = bool(every) and number % every == 0
            begun = time.process_time()
            frame = session.step(STEP, load, tool=tool, certify=certify)
            yield frame, time.process_time() - begun


def in_modes(motion: Motion, reduced: surrogate.ReducedMotion, exact: Array) -> Results:
    """Results of the same motion in modes, beside the displacements of converged steps in m."""
    reduced.begin([1.0] if motion.kind == "let go" else None)
    off, seconds = [], []
    for number, u in enumerate(exact, 1):
        begun = time.process_time()
        found = reduced.step([motion.factor(number)])
        seconds.append(time.process_time() - begun)
        off.append(np.linalg.norm(found - u, axis=1).max())
    size = np.linalg.norm(exact, axis=2).max()
    return {
        "modes": len(reduced.reduced.modes),
        "step_ms": rounded(1e3 * np.median(seconds)),
        "step_90_ms": rounded(1e3 * np.quantile(seconds, 0.9)),
        "off": rounded(max(off) / size),
    }


def compare(
    motion: Motion, tolerance: float, reduced: surrogate.ReducedMotion | None = None
) -> Results:
    """Results of one motion."""
    list(islice(motion.frames(tolerance), 2))  # what is compiled and kept
    found = list(motion.frames(tolerance))
    exact = [frame.displacement for frame, _ in motion.frames(EXACT)]
    certified = [frame for frame, _ in motion.frames(tolerance, EVERY) if frame.certificate]
    u = np.array([frame.displacement for frame, _ in found])
    size = np.linalg.norm(exact, axis=2).max()
    sizes = [np.linalg.norm(each.displacement, axis=1).max() for each in certified]
    of_steps = np.array([frame.error for frame in certified]) / sizes
    off = np.linalg.norm(u - exact, axis=2).max(axis=1)
    last, begin = found[-1][0].energies, found[0][0].energies
    seconds = np.array([taken for _, taken in found])
    directions = np.array([frame.directions for frame, _ in found])
    return {
        "motion": motion.kind,
        "largest": rounded(size),
        "step_ms": rounded(1e3 * np.median(seconds)),
        "step_90_ms": rounded(1e3 * np.quantile(seconds, 0.9)),
        "directions": rounded(directions.mean()),
        "error_of_a_step": rounded(np.median(of_steps)),
        "largest_error_of_a_step": rounded(of_steps.max()),
        "off": rounded(off.max() / size),
        "drift": rounded(last.drift / max(begin.kinetic + begin.strain, last.work, 1e-300)),
        "in_modes": None if reduced is None else in_modes(motion, reduced, np.array(exact)),
    }


def measure(options: argparse.Namespace) -> Results:
    """Results of all motions of a body."""
    model = surrogate.load(options.network)
    made = [Motion(model, kind, options.density, options.force) for kind in MOTIONS]
    begun = time.process_time()
    reduced = surrogate.ReducedMotion(model, [made[0].text], density=options.density, step=STEP)
    results: dict[str, Any] = {
        "nodes": len(model.geometry.coordinates),
        "fit_seconds": rounded(time.process_time() - begun),
    }
    compared = [
        compare(each, options.tolerance, None if each.kind == "hit" else reduced) for each in made
    ]
    return results | {"motions": compared}


def page(results: Results) -> str:
    """Make the page."""
    rows = table_of(
        results["motions"],
        {
            "motion": "{motion}",
            "largest displacement [m]": "{largest:.3g}",
            "step [ms] (90 %)": "{step_ms:.3g} ({step_90_ms:.3g})",
            "directions": "{directions:.2g}",
            "error of a step": "{error_of_a_step:.1e}",
            "largest": "{largest_error_of_a_step:.1e}",
            "off": "{off:.1e}",
            "drift": "{drift:.1e}",
        },
    )
    in_modes = table_of(
        [{"motion": m["motion"], **m["in_modes"]} for m in results["motions"] if m["in_modes"]],
        {
            "motion": "{motion}",
            "modes": "{modes}",
            "step [ms] (90 %)": "{step_ms:.2g} ({step_90_ms:.2g})",
            "off": "{off:.1e}",
        },
    )
    return (
        f"A body of {results['nodes']} nodes is let go from under a force at its tip, pulled by "
        f"the force times sin(2 π t / {PERIOD:g} s), or hit by a sphere that comes and goes in "
        f"{PERIOD:g} s: {STEPS} steps of {1e3 * STEP:.3g} ms, ρ∞ = 0.8. *Error of a step* is that "
        f"of every {EVERY}th one by its certificate, over the largest displacement then; *off* is "
        "the largest distance of a node from that of converged steps, over the largest "
        "displacement of the motion. Times are those of the processor. *Drift* of the energy is "
        "over what the body had at first, or "
        f"has been given; the scheme takes some from fast vibrations.\n\n{rows}\n"
        "The same motions by `surrogate.ReducedMotion`, in modes that know this load; their fit "
        f"takes {results['fit_seconds']:.0f} s:\n\n{in_modes}"
    )


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("network", nargs="?", default="beam3d_any", help="(default beam3d_any)")
    parser.add_argument("--density", type=float, default=0.063, help="in kg/m³ (default 0.063)")
    parser.add_argument("--force", type=float, default=4.0, help="in N (default 4)")
    parser.add_argument("--tolerance", type=float, default=5e-3, help="(default 5e-3)")


TITLE = "Bodies in motion"
