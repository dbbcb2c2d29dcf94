"""Displacements that are so small or so large that a mistake in the units is likely."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SMALLEST, LARGEST = 1e-5, 1.5  # of the longest side of the body
UNITS = (
    "are the units consistent? A mesh in mm needs stresses in MPa, or 'mesh.scale: 0.001' beside "
    "stresses in Pa"
)


def size_warning(
    displacement: NDArray[np.float64],
    coordinates: NDArray[np.float64],
    what: str,
    advice: str = UNITS,
) -> str | None:
    """Say how large displacements are for the body, if that is unusual.

    Displacements of no load are nothing unusual. Of several samples, all must be too small, or half
    of them too large.

    Parameters
    ----------
    displacement : array, (n_nodes, d) or (N, n_nodes, d)
    coordinates : array, (n_nodes, d)
        In the same unit.
    what : str
        Subject of the sentence, such as "the largest displacement".
    advice : str
        End of the sentence.
    """
    fields = displacement.reshape(-1, *coordinates.shape)
    if not fields.any():
        return None
    size = float(np.ptp(coordinates, axis=0).max())
    relative = np.linalg.norm(fields, axis=2).max(axis=1) / size
    largest, usual = float(relative.max()), float(np.median(relative))
    if largest >= SMALLEST and not usual > LARGEST:
        return None
    found = largest if largest < SMALLEST else usual
    return f"{what} is {found:.2g} of the body's size, {size:.4g}; {advice}"
