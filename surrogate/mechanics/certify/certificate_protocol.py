"""What the certificates of one prediction have in common."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

LEVEL = 0.95  # probability of each fast bound


class ErrorCertificate(Protocol):
    """Estimated error of one prediction: `Certificate` (full) or `Bounds` (fast)."""

    @property
    def error(self) -> NDArray[np.float64]:
        """Estimate of the predicted minus the true displacement in m, (n_nodes, d)."""

    def summary(self) -> str:
        """Describe the error in a line."""

    def refusal(self, tolerance: float) -> str | None:
        """Say why no node's error is certified to be at most `tolerance` in m; None if it is."""
