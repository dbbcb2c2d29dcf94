"""Structured datasets of random fields in many shards, as large as wanted."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from shared_schema.grid import Grid
from shared_schema.manifest import (
    ComponentStatistics,
    Manifest,
    ShardEntry,
    StructuredInfo,
    digest_of,
    write_manifest,
)
from shared_schema.shard import write_shard

CASE = {"name": "beam2d", "mesh": {}, "material": {}, "supports": []}


def large_dataset(
    folder: Path, shards: int, samples: int, shape: tuple[int, int] = (8, 4), tests: int = 1
) -> Path:
    """Write a dataset of random fields on a full grid.

    Parameters
    ----------
    folder : Path
    shards, samples : int
        Number of shards, and of samples in each.
    shape : tuple of int
    tests : int
        Number of test samples in each shard.
    """
    folder.mkdir()
    rng = np.random.default_rng(0)
    coordinates = np.argwhere(np.ones(shape, dtype=bool)).astype(np.float64)
    grid = Grid.from_coordinates(coordinates)
    number = np.arange(len(coordinates)).reshape(shape)
    corners = (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    body = {
        "mesh/coordinates": coordinates,
        "mesh/cells": np.stack([corner.ravel() for corner in corners], axis=1),
        "mesh/clamped": coordinates[:, 0] == 0,
        "mesh/loadable": coordinates[:, 0] == shape[0] - 1,
        "grid/node_at": grid.node_at,
        "grid/mask": grid.mask,
    }
    entries = []
    for shard in range(shards):
        force = np.zeros((samples, 2, *shape), dtype=np.float32)
        force[:, :, -1, -1] = rng.uniform(-1, 1, (samples, 2))
        displacement = rng.normal(size=force.shape).astype(np.float32)
        displacement[:, :, 0] = 0
        arrays = body | {
            "samples/number": np.arange(samples) + shard * samples,
            "samples/is_test": np.arange(samples) < tests,
            "samples/force": force,
            "samples/displacement": displacement,
        }
        path = folder / f"shard-{shard:05d}.h5"
        digest = write_shard(path, "structured", arrays, digest_of(CASE), "quad")
        entries.append(ShardEntry(file=path.name, samples=samples, failed=0, sha256=digest))
    one = ComponentStatistics(mean=(0.0, 0.0), std=(1.0, 1.0), max_abs=(1.0, 1.0))
    info = StructuredInfo(
        grid_shape=shape,
        train=shards * (samples - tests),
        test=shards * tests,
        split_seed=0,
        force=one,
        displacement=one,
        source_digest="",
    )
    manifest = Manifest(
        kind="structured",
        name="beam2d",
        case=CASE,
        case_digest=digest_of(CASE),
        seed=0,
        software={},
        dimension=2,
        samples=shards * samples,
        failed=0,
        shards=tuple(entries),
        structured=info,
    )
    write_manifest(folder, manifest)
    return folder
