"""Training: from a configuration and a dataset to a model.

`loop` is what ``surrogate train`` does, epoch by epoch, and `trainer` an epoch, step by step.
`setup` checks and builds what a training starts with, and `sample_store` holds its samples.
`validation`, `training_log` and `checkpoint` are what follows an epoch, `recalibration` what
follows the last one. `data_parallel` and `cuda_graph` make it faster.
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.learning.training.trainer import Trainer

__all__ = [
    "Trainer",
]
__getattr__, __dir__ = lazy_names(__name__)
