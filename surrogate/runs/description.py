"""What a run is made from: its configuration, and the dataset it belongs to."""

from __future__ import annotations

from typing import Any

from shared_schema.common.configuration import Frozen
from shared_schema.common.errors import InputError
from shared_schema.manifest import StructuredInfo
from surrogate.data.dataset import Dataset
from surrogate.runs.configuration import RunConfig


class DataFingerprint(Frozen):
    """Which dataset a run belongs to.

    Attributes
    ----------
    case : dict
        The whole case configuration.
    digest : str
        Digest of the structured dataset.
    dimension : int
    cell_type : str
    info : StructuredInfo
        Grid, split and statistics.
    """

    case: dict[str, Any]
    digest: str
    dimension: int
    cell_type: str
    info: StructuredInfo


class RunDescription(Frozen):
    """Content of ``config.yaml``.

    Attributes
    ----------
    run : RunConfig
    data : DataFingerprint
    """

    run: RunConfig
    data: DataFingerprint


def describe(config: RunConfig, dataset: Dataset) -> RunDescription:
    """Say what a run is made from.

    Raises
    ------
    InputError
        If the configuration is for another case than the dataset's.
    """
    manifest = dataset.manifest
    if config.case != manifest.name:
        raise InputError(
            f"config '{config.name}': key 'case' = '{config.case}', the dataset is of case "
            f"'{manifest.name}'"
        )
    data = DataFingerprint(
        case=manifest.case,
        digest=manifest.digest,
        dimension=manifest.dimension,
        cell_type=dataset.geometry.cell_type,
        info=dataset.info,
    )
    return RunDescription(run=config, data=data)
