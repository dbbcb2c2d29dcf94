"""Networks with random weights on the meshes of given datasets, whose times are measured."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from shared_schema import ComponentStatistics, StructuredInfo
from surrogate import Dataset, read_config
from surrogate.learning.models import UNetModel
from surrogate.learning.networks import UNetConfig
from surrogate.learning.probabilistic import Likelihood
from surrogate.learning.runs import DataFingerprint, RunDescription, RunFolder, run_config

RECIPES = ("paper", "fast")
LIKELIHOODS: tuple[Likelihood, ...] = ("deterministic", "variational_bayes")


def shipped_unet(name: str) -> UNetModel:
    """Read a shipped configuration of U-Nets."""
    config = read_config(name)
    assert isinstance(config, UNetModel)
    return config


def changed(config: UNetModel, network: dict[str, Any], training: dict[str, Any]) -> UNetModel:
    """Return a configuration with some changed keys."""
    return config.model_copy(
        update={
            "network": config.network.model_copy(update=network),
            "training": config.training.model_copy(update=training),
        }
    )


def shape_of(recipe: str, dimension: int) -> UNetConfig:
    """U-Net of a recipe."""
    if recipe == "fast":
        return shipped_unet("beam2d-det-fast").network
    return UNetConfig(levels=3 if dimension == 2 else 4)


def untrained(
    dataset: Dataset,
    recipe: str,
    likelihood: Likelihood,
    folder: Path,
    shape: UNetConfig | None = None,
) -> RunFolder:
    """Write a run folder with random weights and scales of 1; `shape` replaces the recipe's."""
    geometry, manifest = dataset.geometry, dataset.manifest
    dimension = geometry.dimension
    zero, one = (0.0,) * dimension, (1.0,) * dimension
    units = ComponentStatistics(mean=zero, std=one, max_abs=one)
    info = StructuredInfo(
        grid_shape=geometry.grid.shape,
        train=1,
        test=0,
        split_seed=0,
        force=units,
        displacement=units,
        source_digest="",
    )
    config = run_config(
        {
            "name": recipe,
            "case": manifest.name,
            "likelihood": likelihood,
            "network": (shape or shape_of(recipe, dimension)).model_dump(),
            **({"variational": {}} if likelihood == "variational_bayes" else {}),
        }
    )
    data = DataFingerprint(
        case=manifest.case,
        digest="",
        dimension=dimension,
        cell_type=geometry.cell_type,
        info=info,
    )
    description = RunDescription(run=config, data=data)
    run = RunFolder(folder)
    run.start(description)
    network = description.run.build(geometry, description.data.info)
    run.write_tensors({**network.state_dict(), **geometry.tensors()})
    return run
