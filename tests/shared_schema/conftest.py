"""Tiny datasets: an L-shaped mesh of three quadrilaterals, two shards with three samples.

The grid is 3 × 3 with the corner (2, 2) empty, so there are 8 nodes; nodes are numbered in grid
order. Sample 2 is a failed load case, sample 3 belongs to the test split.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from shared_schema.layout import Arrays, Kind
from shared_schema.manifest import (
    ComponentStatistics,
    Manifest,
    ShardEntry,
    StructuredInfo,
    digest_of,
    write_manifest,
)
from shared_schema.shard import write_shard

CASE = {"name": "corner", "mesh": {"kind": "l_shape"}, "material": {"young_modulus": 500.0}}
NODE_AT = np.array([[0, 1, 2], [3, 4, 5], [6, 7, -1]])


def mesh() -> Arrays:
    position = np.argwhere(NODE_AT >= 0)
    return {
        "mesh/coordinates": position.astype(np.float64),
        "mesh/cells": np.array([[0, 3, 4, 1], [1, 4, 5, 2], [3, 6, 7, 4]]),
        "mesh/clamped": position[:, 0] == 0,
        "mesh/loadable": position[:, 0] == 2,
    }


def make_nodal(numbers: list[int], failed: list[int]) -> Arrays:
    count, lost = len(numbers), len(failed)
    rng = np.random.default_rng([11, *numbers])
    displacement = rng.normal(size=(count, 8, 2))
    displacement[:, :3] = 0.0
    return {
        **mesh(),
        "samples/number": np.array(numbers, dtype=np.int64),
        "samples/loaded_nodes": np.tile(np.array([[6, -1]]), (count, 1)),
        "samples/force": np.tile(np.array([[[1.5, -0.5], [0.0, 0.0]]]), (count, 1, 1)),
        "samples/displacement": displacement,
        "samples/converged_reason": np.full(count, 3),
        "samples/load_steps": np.full(count, 2),
        "samples/cutbacks": np.zeros(count, dtype=np.int64),
        "samples/newton_iterations": np.full(count, 9),
        "samples/residual_norm": np.full(count, 1e-9),
        "samples/wall_time": np.full(count, 0.25),
        "failed/number": np.array(failed, dtype=np.int64),
        "failed/loaded_nodes": np.tile(np.array([[7, 6]]), (lost, 1)),
        "failed/force": np.tile(np.array([[[9.0, 9.0], [8.0, 8.0]]]), (lost, 1, 1)),
        "failed/load_factor": np.full(lost, 0.5),
        "failed/reason": np.array(["no equilibrium – gave up"] * lost, dtype=object),
    }


def make_structured(numbers: list[int], is_test: list[bool]) -> Arrays:
    mask = NODE_AT >= 0
    rng = np.random.default_rng([12, *numbers])
    force = np.zeros((len(numbers), 2, 3, 3), dtype=np.float32)
    force[:, 1, 2, 0] = 2.0
    displacement = (rng.normal(size=(len(numbers), 2, 3, 3)) * mask).astype(np.float32)
    displacement[:, :, 0] = 0.0
    return {
        **mesh(),
        "grid/node_at": NODE_AT.copy(),
        "grid/mask": mask,
        "samples/number": np.array(numbers, dtype=np.int64),
        "samples/is_test": np.array(is_test, dtype=bool),
        "samples/force": force,
        "samples/displacement": displacement,
    }


def make_dataset(folder: Path, kind: Kind) -> Path:
    folder.mkdir()
    shards = (
        [make_nodal([0, 1], [2]), make_nodal([3], [])]
        if kind == "nodal"
        else [make_structured([0, 1], [False, False]), make_structured([3], [True])]
    )
    entries = []
    for index, arrays in enumerate(shards):
        file = f"shard-{index:05d}.h5"
        entries.append(
            ShardEntry(
                file=file,
                samples=len(arrays["samples/number"]),
                failed=len(arrays.get("failed/number", ())),
                sha256=write_shard(folder / file, kind, arrays, digest_of(CASE), "quad"),
            )
        )
    statistics = ComponentStatistics(mean=(0.0, 0.5), std=(1.0, 1.0), max_abs=(0.0, 2.0))
    info = StructuredInfo(
        grid_shape=(3, 3),
        train=2,
        test=1,
        split_seed=5,
        force=statistics,
        displacement=statistics,
        source_digest="0" * 64,
    )
    manifest = Manifest(
        kind=kind,
        name="corner",
        case=CASE,
        case_digest=digest_of(CASE),
        seed=5,
        software={"h5py": "3"},
        dimension=2,
        samples=3,
        failed=sum(entry.failed for entry in entries),
        shards=tuple(entries),
        structured=info if kind == "structured" else None,
    )
    write_manifest(folder, manifest)
    return folder


@pytest.fixture
def nodal(tmp_path: Path) -> Path:
    return make_dataset(tmp_path / "nodal", "nodal")


@pytest.fixture
def structured(tmp_path: Path) -> Path:
    return make_dataset(tmp_path / "structured", "structured")


@pytest.fixture
def nodal_arrays() -> Arrays:
    return make_nodal([0, 1], [2])


@pytest.fixture
def structured_arrays() -> Arrays:
    return make_structured([0, 1], [False, True])


@pytest.fixture
def empty_nodal_arrays() -> Arrays:
    """No solved sample and no failed one."""
    return make_nodal([], [])


@pytest.fixture
def empty_structured_arrays() -> Arrays:
    return make_structured([], [])
