"""Data: datasets as tensors, samples in memory or on disk, bodies, random loads."""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.learning.data.case_loads import RandomLoads
    from surrogate.learning.data.dataset import Dataset
    from surrogate.learning.data.samples import (
        NodalDataset,
        NodalSamples,
        Samples,
        read_nodal_dataset,
    )
    from surrogate.mechanics.body.geometry import Geometry, at_free

__all__ = [
    "Dataset",
    "Geometry",
    "NodalDataset",
    "NodalSamples",
    "RandomLoads",
    "Samples",
    "at_free",
    "read_nodal_dataset",
]
__getattr__, __dir__ = lazy_names(__name__)
