"""Force sweeps made by hand, for tests of what is said of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from surrogate.force_sweep import ForceSweep


def hand_made(**changes: Any) -> ForceSweep:
    """From −4 N to 4 N, trained up to 2 N; u = f m, no error, σ = 1 mm inside and f² mm outside."""
    force = np.arange(-4.0, 5.0)
    std = np.where(np.abs(force) > 2, force**2, 1.0) * 1e-3
    fields: dict[str, Any] = {
        "axis": 1,
        "limit": 2.0,
        "force": force,
        "reference": force,
        "mean": force,
        "std_epistemic": std,
        "std_aleatoric": 0 * std,
        "covered_components": np.ones_like(force),
    }
    return ForceSweep(**fields | changes)
