"""Optimisers, learning-rate schedules, weight averages, early stopping."""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.learning.optim.early_stopping import EarlyStopping, EarlyStoppingConfig
    from surrogate.learning.optim.muon import Muon
    from surrogate.learning.optim.optimisers import (
        OptimiserConfig,
        make_optimisers,
        set_learning_rate,
    )
    from surrogate.learning.optim.schedule import ScheduleConfig
    from surrogate.learning.optim.weight_average import WeightAverage

__all__ = [
    "EarlyStopping",
    "EarlyStoppingConfig",
    "Muon",
    "OptimiserConfig",
    "ScheduleConfig",
    "WeightAverage",
    "make_optimisers",
    "set_learning_rate",
]
__getattr__, __dir__ = lazy_names(__name__)
