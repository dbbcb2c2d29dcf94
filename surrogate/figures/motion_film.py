"""A film of a body in motion: its surface, picture after picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError
from surrogate.mechanics.body.geometry import Geometry

Array = NDArray[np.float64]
RATE = 25  # pictures in a second


def write_film(path: Path, geometry: Geometry, times: Array, displacement: Array) -> None:
    """Write .gif, or .mp4 where ffmpeg is installed, at the pace of the motion.

    Parameters
    ----------
    path : Path
    geometry : Geometry
    times : array, (n_frames,)
        In s.
    displacement : array, (n_frames, n_nodes, d)
        In m.

    Raises
    ------
    InputError
        If there is no ffmpeg.
    """
    from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    if path.suffix == ".mp4" and not FFMpegWriter.isAvailable():
        raise InputError(f"--out {path}: films .mp4 need ffmpeg, expected .gif")
    at = np.arange(times[0], times[-1] + 0.5 / RATE, 1 / RATE)
    shown = geometry.coordinates + displacement[np.searchsorted(times, at).clip(max=len(times) - 1)]
    figure, d = Figure(figsize=(6, 4)), geometry.dimension
    low, high = shown.min(axis=(0, 1)), shown.max(axis=(0, 1))
    facets = geometry.cells if d == 2 else geometry.surface_facets
    paint: dict[str, Any] = {
        "facecolors": "lightsteelblue",
        "edgecolors": "black",
        "linewidths": 0.3,
    }
    if d == 2:
        axes = figure.add_subplot()
        body = PolyCollection(shown[0][facets], **paint)
        axes.add_collection(body)
    else:
        axes = figure.add_subplot(projection="3d")
        body = Poly3DCollection(shown[0][facets], **paint)
        axes.add_collection3d(body)
        axes.set_zlim(low[2], high[2])
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")

    def draw(number: int) -> list[object]:
        body.set_verts(shown[number][facets])
        return [body]

    film = FuncAnimation(figure, draw, frames=len(shown))  # type: ignore[arg-type]
    writer = PillowWriter(fps=RATE) if path.suffix == ".gif" else FFMpegWriter(fps=RATE)
    film.save(str(path), writer=writer)
