"""Measures of predictions beside the finite elements: errors, stresses, other loads, sweeps."""

from surrogate.learning.measures.error_metrics import (
    ErrorMeasures,
    displacement_at_load,
    measure,
    node_errors,
    sample_errors,
)
from surrogate.learning.measures.extrapolation import BAND, Extrapolation, extrapolate
from surrogate.learning.measures.force_sweep import (
    ForceSweep,
    find_example,
    force_sweep,
    tip_measures,
)

__all__ = [
    "BAND",
    "ErrorMeasures",
    "Extrapolation",
    "ForceSweep",
    "displacement_at_load",
    "extrapolate",
    "find_example",
    "force_sweep",
    "measure",
    "node_errors",
    "sample_errors",
    "tip_measures",
]
