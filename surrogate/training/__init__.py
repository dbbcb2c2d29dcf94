"""Training: loop, checkpoints, data parallelism, CUDA graphs, compilation."""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.training.loop import train
    from surrogate.training.refinement import refine
    from surrogate.training.trainer import Trainer

__all__ = [
    "Trainer",
    "refine",
    "train",
]
__getattr__ = lazy_names(
    __name__,
    {
        "Trainer": "trainer",
        "refine": "refinement",
        "train": "loop",
    },
)
