"""Rigid spheres that push bodies: forces and fields beside the finite elements', times of frames.

A sphere comes from outside to a random point of the free surface, where it touches no other part of
the body, and goes in along the normal by a random depth, in a number of frames. The truth is the
equilibrium of the finite elements with the tool.

    python -m experiments benchmark tools beam3d_any_reduced:200 runs/finger:40

writes its record and its page.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import surrogate
from experiments.benchmarks.benchmark import Results
from experiments.benchmarks.directions import rounded
from experiments.framework.counted_networks import add_counted_networks, over_networks
from experiments.framework.report import table_of
from experiments.framework.timing import timed
from shared_schema.common import Parser, WorkError
from shared_schema.tools import Sphere

Array = NDArray[np.float64]
NETWORKS = ["beam2d_any:200", "beam3d_any_reduced:200"]
RADIUS = 0.3  # of the smallest side of the body
DEPTHS = (0.05, 0.25)  # least and largest, of the same
FRAMES = 30
WITHIN = (0.02, 0.04, 0.05, 0.08)


class Approach:
    """A sphere in front of a surface.

    Attributes
    ----------
    place, normal : array, (d,)
        Point that is touched first, and the direction out of the body.
    radius, depth : float
        In m.
    """

    def __init__(self, geometry: Any, rng: np.random.Generator) -> None:
        x, free = geometry.coordinates, ~geometry.clamped
        facets = geometry.surface_facets
        facets = facets[free[facets].all(axis=1)]
        side = float(np.ptp(x, axis=0).min())
        self.radius, self.depth = RADIUS * side, side * rng.uniform(*DEPTHS)
        while True:
            corners = x[facets[rng.integers(len(facets))]]
            weights = rng.dirichlet(np.ones(len(corners)))
            self.place = weights @ corners
            edge, other = corners[1] - corners[0], corners[-1] - corners[0]
            normal = np.array([edge[1], -edge[0]]) if len(edge) == 2 else np.cross(edge, other)
            self.normal = normal / np.linalg.norm(normal)
            clear = self.sphere(0.0).gap(x).min() > -1e-9 * side
            if clear and self.sphere(self.depth).gap(x[geometry.clamped]).min() > side / 2:
                return

    def sphere(self, depth: float) -> Sphere:
        """The sphere when it has gone in by a depth in m."""
        return Sphere(tuple(self.place + (self.radius - depth) * self.normal), self.radius)


def pushed(
    touch: surrogate.Touch, approach: Approach
) -> tuple[surrogate.TouchFrame, list[float], list[float]]:
    """Last frame of an approach, and the seconds of frames and of reactions in between."""
    touch.let_go()
    frames, between = [], []
    for share in np.linspace(0, 1, FRAMES + 1)[1:]:
        frame, taken = timed(partial(touch.move, approach.sphere(share * approach.depth)))
        near = approach.sphere((share + 0.2 / FRAMES) * approach.depth)
        frames.append(taken)
        between.append(timed(partial(touch.reaction, near))[1])
    return frame, frames, between


def compare(name: str, count: int, seed: int) -> Results:
    """Push one body at random places."""
    model = surrogate.load(name)
    geometry = model.geometry
    touch, found = surrogate.Touch(model), []
    failed = without = solved = 0
    frames: list[float] = []
    between: list[float] = []

    for number in range(count):
        approach = Approach(geometry, np.random.default_rng([seed, number]))
        tool = approach.sphere(approach.depth)
        try:
            frame, *_ = pushed(touch, approach)  # columns of the stiffness are solved for and kept
            if frame.correction is None:  # there are predictions, whose times count
                frame, of_frames, of_reactions = pushed(touch, approach)
                frames += of_frames
                between += of_reactions
        except WorkError as error:
            print(name, number, error, file=sys.stderr)
            failed += 1
            continue
        try:
            truth = touch.correct(tool)
        except WorkError:
            without += 1
            continue
        solved += frame.correction is not None
        off = np.linalg.norm(frame.displacement - truth.displacement, axis=1).max()
        wrong = np.linalg.norm(frame.reaction - truth.reaction)
        found.append(
            (
                wrong / np.linalg.norm(truth.reaction),
                off / approach.depth,
                frame.penetration / approach.radius,
                off / np.linalg.norm(truth.displacement, axis=1).max(),
            )
        )
        print(name, number, *(f"{value:.1e}" for value in found[-1]), file=sys.stderr)
    forces, fields, depths, relative = np.array(found).T
    tried = len(found) + failed
    return {
        "name": name,
        "poses": tried + without,
        "failed": failed,
        "without_equilibrium": without,
        "solved": solved,
        "force_median": rounded(np.median(forces)),
        "force_95": rounded(np.quantile(forces, 0.95)),
        "force_within": {str(w): rounded(np.sum(forces <= w) / tried) for w in WITHIN},
        "field_median": rounded(np.median(fields)),
        "field_within": {str(w): rounded(np.sum(fields <= w) / tried) for w in WITHIN},
        "relative_median": rounded(np.median(relative)),
        "penetration": rounded(depths.max()),
        "frame_ms": rounded(1e3 * np.median(frames)),
        "frame_90_ms": rounded(1e3 * np.quantile(frames, 0.9)),
        "reaction_ms": rounded(1e3 * np.median(between)),
    }


def measure(options: argparse.Namespace) -> Results:
    """Results for some networks."""
    return over_networks(options, partial(compare, seed=options.seed))


def page(results: Results) -> str:
    """Make the page."""
    rows = table_of(
        results["networks"],
        {
            "network": "`{name}`",
            "poses": "{poses}",
            "no forces found": "{failed}",
            "no prediction": "{solved}",
            "force, median": "{force_median:.2g}",
            "within 5 %": "{force_within[0.05]:.1%}",
            "field, median": "{field_median:.2g}",
            "within 2 % of the depth": "{field_within[0.02]:.1%}",
            "penetration": "{penetration:.1e}",
            "frame [ms] (90 %)": "{frame_ms:.3g} ({frame_90_ms:.3g})",
            "reaction [ms]": "{reaction_ms:.3g}",
        },
    )
    return (
        f"A sphere, whose radius is {RADIUS:g} of the smallest side of the body, goes into a "
        "random point of the free surface, half as far from the supports as this side at least, "
        "along the "
        f"normal in {FRAMES} frames, by {DEPTHS[0]:g} to {DEPTHS[1]:g} of the side (seed "
        f"{results['seed']}, {results['threads']} thread). The last frame is compared with the "
        "contact of the finite elements: the resultant relative to theirs, the worst node to the "
        "depth. *Penetration* is the largest, over the radius. *Reaction* is the time of "
        "`Touch.reaction`. *No prediction* counts poses whose forces alone leave the body "
        f"unstable; Newton's method finds them together with the contact.\n\n{rows}"
    )


def arguments(parser: Parser) -> None:
    """Add the options."""
    add_counted_networks(parser, NETWORKS, "poses", seed=311)


TITLE = "Bodies that a sphere pushes"
