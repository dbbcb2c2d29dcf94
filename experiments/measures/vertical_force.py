"""Description of a vertical force."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def describe_vertical_force(force: NDArray[np.float64]) -> str:
    """Describe the vertical force on a body, (n_nodes, d) in N, such as ``1.5 N upwards``."""
    newtons = float(force[:, 1].sum())
    return f"{abs(newtons):.3g} N {'upwards' if newtons > 0 else 'downwards'}"
