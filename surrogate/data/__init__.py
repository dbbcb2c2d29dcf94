"""Data: datasets as tensors, samples in memory or on disk, bodies, random loads."""

from surrogate.data.dataset import Dataset
from surrogate.data.geometry import Geometry
from surrogate.data.joined_dataset import read_dataset
from surrogate.data.nodal_dataset import NodalDataset, NodalSamples, read_nodal_dataset
from surrogate.data.random_loads import RandomLoads, random_loads
from surrogate.data.samples import Samples
from surrogate.data.samples_on_disk import SamplesOnDisk

__all__ = [
    "Dataset",
    "Geometry",
    "NodalDataset",
    "NodalSamples",
    "RandomLoads",
    "Samples",
    "SamplesOnDisk",
    "random_loads",
    "read_dataset",
    "read_nodal_dataset",
]
