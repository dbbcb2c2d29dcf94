"""Measures of predictions beside the finite elements: errors, stresses, other loads, sweeps."""

from surrogate.learning.measures.error_metrics import (
    ErrorMeasures,
    displacement_at_load,
    measure,
    node_errors,
    sample_errors,
)
from surrogate.learning.measures.extrapolation import BAND, Extrapolation, extrapolate
from surrogate.learning.measures.force_sweep import ForceSweep, force_sweep
from surrogate.learning.measures.shown_sample import find_example, tip_measures
from surrogate.learning.measures.stress_errors import StressMeasures, measure_stresses

__all__ = [
    "BAND",
    "ErrorMeasures",
    "Extrapolation",
    "ForceSweep",
    "StressMeasures",
    "displacement_at_load",
    "extrapolate",
    "find_example",
    "force_sweep",
    "measure",
    "measure_stresses",
    "node_errors",
    "sample_errors",
    "tip_measures",
]
