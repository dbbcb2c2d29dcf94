"""The contract between the data factory (`datagen`) and the learner (`surrogate`).

The two programs share nothing but files; this package defines their content and is the only
code that both import. It needs h5py and numpy, and meshio for VTU files; no solver, no torch.
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from shared_schema.checker import check_dataset
    from shared_schema.dataset_reader import DatasetReader
    from shared_schema.grid import Grid, grid_of
    from shared_schema.layout import Arrays, Kind
    from shared_schema.load_cases import LoadCases, read_load_cases, write_load_cases
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
    from shared_schema.materials import NeoHookean, OwnMaterial
    from shared_schema.points_in_cells import locate
    from shared_schema.shard import read_shard, write_shard
    from shared_schema.stiffness import Stiffness, read_stiffness, write_stiffness

__version__ = "1.0.0"
__all__ = [
    "MANIFEST",
    "Arrays",
    "ComponentStatistics",
    "DatasetReader",
    "Grid",
    "Kind",
    "LoadCases",
    "Manifest",
    "NeoHookean",
    "NodeOrder",
    "OwnMaterial",
    "ShardEntry",
    "Stiffness",
    "StructuredInfo",
    "check_dataset",
    "digest_of",
    "grid_of",
    "locate",
    "read_load_cases",
    "read_manifest",
    "read_shard",
    "read_stiffness",
    "write_load_cases",
    "write_manifest",
    "write_shard",
    "write_stiffness",
]
__getattr__, __dir__ = lazy_names(__name__)
