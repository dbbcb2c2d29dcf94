"""A vertical force in words."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def in_words(force: NDArray[np.float64]) -> str:
    """Vertical force on a body, (n_nodes, d) in N, such as ``1.5 N upwards``."""
    newtons = float(force[:, 1].sum())
    return f"{abs(newtons):.3g} N {'upwards' if newtons > 0 else 'downwards'}"
