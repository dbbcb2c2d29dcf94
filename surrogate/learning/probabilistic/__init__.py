"""Random weights and outputs: likelihoods, Flipout, dropout, ensembles, passes, and their moments.

A pass is one prediction with drawn weights (`flipout`, dropout) or by one member of an ensemble;
each has a mean and, with a likelihood, a standard deviation. `distribution` joins the passes to one
distribution, and `calibration` measures distributions against reference solutions.
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.learning.probabilistic.calibration import (
        INTERVALS,
        CalibrationMeasures,
        half_width,
        measure_calibration,
        rank_correlation,
    )
    from surrogate.learning.probabilistic.distribution import Distribution
    from surrogate.learning.probabilistic.likelihoods import Likelihood
    from surrogate.learning.probabilistic.stochastic_passes import MOST_PASSES, PASSES

__all__ = [
    "INTERVALS",
    "MOST_PASSES",
    "PASSES",
    "CalibrationMeasures",
    "Distribution",
    "Likelihood",
    "half_width",
    "measure_calibration",
    "rank_correlation",
]
__getattr__, __dir__ = lazy_names(__name__)
