"""Force sweeps made by hand, for tests of their measures and claims."""

from __future__ import annotations

from typing import Any

import numpy as np

from surrogate.learning.measures.force_sweep import ForceSweep


def hand_made(**changes: Any) -> ForceSweep:
    """Sweep from −4 N to 4 N, trained up to 2 N; u = f m, no error, σ = 1 mm inside, f² mm outside.

    Displacements across the force are zero; `changes` replaces attributes.
    """
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
    } | changes
    along = {
        "node_error": np.abs(fields["mean"] - fields["reference"]),
        "moved": np.abs(fields["reference"]),
        "covered_across": np.ones_like(fields["force"], dtype=bool),
    }
    return ForceSweep(**along | fields)
