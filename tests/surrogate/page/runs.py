"""Run folders of networks with random weights, on any cells, for pages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.runs.description import describe
from surrogate.learning.runs.folder import RunFolder
from surrogate.mechanics.body.geometry import Geometry
from tests.surrogate.unet_configs import unet_config

LINEAR = {"inputs": ["force", "linear_gradient"], "skip": "linear"}


def untrained(
    folder: Path,
    dataset: Dataset,
    geometry: Geometry,
    network: dict[str, Any],
    units: dict[str, str] | None = None,
    **content: Any,
) -> Path:
    """Write a run of U-Nets with random weights, those of a likelihood or an ensemble too."""
    config = unet_config(
        name="small",
        case=dataset.manifest.name,
        network={"levels": 2, "channels": 4, "padding": 1, **network},
        **content,
    )
    described = describe(config, dataset)
    case = described.data.case | ({} if units is None else {"units": units})
    data = described.data.model_copy(update={"cell_type": geometry.cell_type, "case": case})
    description = described.model_copy(update={"data": data})
    torch.manual_seed(0)
    model = config.build(geometry, data.info, data.material if config.needs_material else None)
    run = RunFolder(folder)
    run.start(description)
    run.write_tensors({**model.state_dict(), **geometry.tensors()})
    return folder
