r"""Displacements of the tip of a beam of silicone, by markers that stand off its surface.

The markers are glued on with errors of half a millimetre. In each recording, the rigid motion that
brings the six markers, held, to where they were meant to be gives the frame of the beam. From there
to rest the three markers of the tip move like a rigid body, :math:`x \mapsto R x + t`, so that the
point X of the surface from which a marker stands off has moved by :math:`(R - 1) X + t`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
FILE, SWINGS = (Path(__file__).with_name(name) for name in ("positions.csv", "swings.csv"))
RATE = 100.0  # frames per second
RECORDINGS = ("gravity_a", "gravity_b", "load52_a", "load52_b")
TIP = np.array(
    [[0, 0.015, 0.036], [0, -0.006, 0.024], [0, 0.036, 0.006]]
)  # m, where they were meant
BASE = np.array([[-0.094, -0.01, -0.001], [-0.094, 0.04, 0.0275], [-0.094, 0.04, 0]])
FEET = np.array([[0, 0.015, 0.03], [0, 0, 0.024], [0, 0.03, 0.006]])  # m, of the tip's markers
MEANT = np.concatenate([TIP, BASE])


def recorded() -> dict[str, tuple[Array, Array, Array]]:
    """Places in m, (6, 3), where the markers are held and at rest, and noise in m, (6,)."""
    table = np.loadtxt(FILE, delimiter=",", skiprows=1, usecols=range(2, 9))
    parts = np.split(table, len(RECORDINGS))
    return {n: (p[:, :3], p[:, 3:6], p[:, 6]) for n, p in zip(RECORDINGS, parts, strict=True)}


def swings() -> dict[str, Array]:
    """Vertical displacements in m, (frames,), of the tip from first motion on: mean of 3 points."""
    table = np.loadtxt(SWINGS, delimiter=",", skiprows=1)
    return dict(zip(RECORDINGS, table.T, strict=True))


def rigid_motion(places: Array, others: Array) -> tuple[Array, Array]:
    """Rotation and shift that bring places next to others, both (m, 3) (Kabsch 1976)."""
    middle, other = places.mean(axis=0), others.mean(axis=0)
    u, _, vt = np.linalg.svd((places - middle).T @ (others - other))
    turn = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u @ turn @ vt).T
    return rotation, other - rotation @ middle


def in_frame(held: Array, rest: Array, meant: Array = MEANT) -> tuple[Array, Array]:
    """Both places of all markers in the frame of the beam."""
    rotation, shift = rigid_motion(held, meant)
    return held @ rotation.T + shift, rest @ rotation.T + shift


def moved(held: Array, rest: Array, meant: Array = MEANT) -> Array:
    """Displacements in m, (3, 3), of the tip's points that the markers stand off."""
    before, after = in_frame(held, rest, meant)
    rotation, shift = rigid_motion(before[:3], after[:3])
    return np.asarray(FEET @ rotation.T + shift - FEET)


def placement_error() -> float:
    """Standard deviation in m of a component of a marker's place, of what rigid motions leave.

    The same in all recordings, so that a fit to one of them, with six parameters, is all there is.
    """
    left = [in_frame(held, rest)[0] - MEANT for held, rest, _ in recorded().values()]
    return float(np.sqrt(np.mean(np.square(left)) * MEANT.size / (MEANT.size - 6)))
