"""The contract between the data factory (`datagen`) and the learner (`surrogate`).

The two programs share nothing but files; this package defines their content and is the only
code that both import. It needs h5py and numpy, and meshio for VTU files; no solver, no torch.
"""

from shared_schema.dataset_reader import DatasetReader
from shared_schema.grid import Grid
from shared_schema.layout import Arrays, Kind
from shared_schema.manifest import (
    MANIFEST,
    ComponentStatistics,
    Manifest,
    NodeOrder,
    ShardEntry,
    StructuredInfo,
    digest_of,
    read_manifest,
    write_manifest,
)
from shared_schema.material import NeoHookean
from shared_schema.shard_reader import read_shard
from shared_schema.shard_writer import write_shard

__version__ = "0.2.0"
__all__ = [
    "MANIFEST",
    "Arrays",
    "ComponentStatistics",
    "DatasetReader",
    "Grid",
    "Kind",
    "Manifest",
    "NeoHookean",
    "NodeOrder",
    "ShardEntry",
    "StructuredInfo",
    "digest_of",
    "read_manifest",
    "read_shard",
    "write_manifest",
    "write_shard",
]
