"""Training: from a configuration and a dataset to a model.

`loop` is what ``surrogate train`` does, epoch by epoch, and `trainer` an epoch, step by step.
`setup` checks and builds what a training starts with, from the weights of another run by
`warm_start`; `sample_store` and `sample_paths` hold its samples and their load paths. `validation`,
`remarks`, `training_log` and `checkpoint` are what follows an epoch, `recalibration` what follows
the last one. `data_parallel`, `cuda_graph` and `compilation` make it faster.
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.learning.training.trainer import Trainer

__all__ = [
    "Trainer",
]
__getattr__, __dir__ = lazy_names(__name__)
