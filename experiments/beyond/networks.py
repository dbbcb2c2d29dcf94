"""Networks and bodies of the studies beyond the paper: names of runs, labels and colours.

A run is called CASE-KIND, or CASE-KIND-nN if it is trained on N samples.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from experiments.framework.scale import Scale
from shared_schema.common.drawing import NETWORK
from surrogate.figures import CURVES

GREY, TEAL = "0.45", "#1295a8"
GREEN, ORANGE, PURPLE = CURVES[2:]
BODIES = {
    "beam2d_any": "2D beam",
    "lshape2d_any": "2D L-shape",
    "beam3d_any": "3D beam",
}


class Kind(NamedTuple):
    """A kind of network: its label, and the colour and marker of its curves."""

    label: str
    color: str
    marker: str


KINDS = {
    "forces": Kind("U-Net, forces in", GREY, "s"),
    "mechanics": Kind("U-Net with mechanics", NETWORK, "o"),
    "reduced": Kind("reduced network", ORANGE, "^"),
    "gp": Kind("POD with GP on forces", GREEN, "v"),
    "modal-gp": Kind("GP on modal loads", TEAL, "P"),
    "forces-mle": Kind("MLE, forces in", GREEN, "v"),
    "forces-vb": Kind("VB, forces in", GREY, "s"),
    "forces-ensemble": Kind("ensemble, forces in", PURPLE, "D"),
    "mechanics-mle": Kind("MLE with mechanics", GREEN, "v"),
    "mechanics-vb": Kind("VB with mechanics", NETWORK, "o"),
    "mechanics-ensemble": Kind("ensemble with mechanics", PURPLE, "D"),
    "reduced-vb": Kind("reduced network, VB", ORANGE, "^"),
}


def kind_of(run: str) -> Kind:
    """Kind of a run, by its name."""
    return KINDS[re.sub(r"-n\d+$", "", run.partition("-")[2])]


def stem_of(case: str) -> str:
    """Begin of the names of all cases of a body: ``beam2d`` of ``beam2d_any``."""
    return case.removesuffix("_any")


def runs_by_body(scale: Scale, kinds: Sequence[str]) -> dict[str, list[str]]:
    """Names of the runs of some kinds, by their case; cases without any of them are left out."""
    found = {
        case: [run for kind in kinds if (run := f"{case}-{kind}") in scale.runs] for case in BODIES
    }
    return {case: runs for case, runs in found.items() if runs}


def patterns(cases: Sequence[str], kinds: Sequence[str]) -> tuple[str, ...]:
    """Names of the runs of some cases and kinds, for a study."""
    return tuple(f"{case}-{kind}" for case in cases for kind in kinds)
