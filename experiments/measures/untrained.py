"""Networks with random weights on the meshes of given datasets, whose times are measured."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.measures.solutions import typical_seconds
from shared_schema import ComponentStatistics, DatasetReader, Grid, Manifest, StructuredInfo
from shared_schema.common import scatter_forces
from surrogate import read_config
from surrogate.learning.data import Geometry
from surrogate.learning.models import UNetModel
from surrogate.learning.networks import UNetConfig
from surrogate.learning.probabilistic import Likelihood
from surrogate.learning.runs import DataFingerprint, RunDescription, RunFolder, run_config

RECIPES = ("paper", "fast")
LIKELIHOODS: tuple[Likelihood, ...] = ("deterministic", "variational_bayes")
Array = NDArray[np.float64]


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


@dataclass(frozen=True)
class Body:
    """Mesh of a nodal dataset, one of its loads, and the solver's time.

    Attributes
    ----------
    manifest : Manifest
    geometry : Geometry
    force : array, (1, n_nodes, d)
        Nodal forces of the first sample, in N.
    solving_ms : float
        Median time of the solver over the samples, in ms.
    """

    manifest: Manifest
    geometry: Geometry
    force: Array
    solving_ms: float


def read_body(folder: Path) -> Body:
    """Read mesh, first load and solving times of a nodal dataset."""
    reader = DatasetReader(folder, "nodal")
    arrays = reader.body
    coordinates = arrays["mesh/coordinates"]
    geometry = Geometry(
        coordinates,
        arrays["mesh/cells"],
        reader.cell_type,
        arrays["mesh/clamped"],
        arrays["mesh/loadable"],
        Grid.from_coordinates(coordinates),
    )
    samples = reader.joined(("samples/loaded_nodes", "samples/force"))
    nodes, loads = samples["samples/loaded_nodes"], samples["samples/force"]
    force = scatter_forces(nodes[:1], loads[:1], len(coordinates))
    return Body(reader.manifest, geometry, force, 1e3 * typical_seconds(folder))


def shape_of(recipe: str, dimension: int) -> UNetConfig:
    """U-Net of a recipe."""
    if recipe == "fast":
        return shipped_unet("beam2d-det-fast").network
    return UNetConfig(levels=3 if dimension == 2 else 4)


def untrained(
    body: Body, recipe: str, likelihood: Likelihood, folder: Path, shape: UNetConfig | None = None
) -> RunFolder:
    """Write a run folder with random weights and scales of 1; `shape` replaces the recipe's."""
    dimension = body.geometry.dimension
    zero, one = (0.0,) * dimension, (1.0,) * dimension
    units = ComponentStatistics(mean=zero, std=one, max_abs=one)
    info = StructuredInfo(
        grid_shape=body.geometry.grid.shape,
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
            "case": body.manifest.name,
            "likelihood": likelihood,
            "network": (shape or shape_of(recipe, dimension)).model_dump(),
            **({"variational": {}} if likelihood == "variational_bayes" else {}),
        }
    )
    data = DataFingerprint(
        case=body.manifest.case,
        digest="",
        dimension=dimension,
        cell_type=body.geometry.cell_type,
        info=info,
    )
    description = RunDescription(run=config, data=data)
    run = RunFolder(folder)
    run.start(description)
    network = description.run.build(body.geometry, description.data.info)
    run.write_tensors({**network.state_dict(), **body.geometry.tensors()})
    return run
