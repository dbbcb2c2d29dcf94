"""Noise against its definition: one factor a sample, within 20 %, only for small loads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from datagen.cases.case import read_case
from datagen.farm.farm import run
from datagen.transforms.added_noise import add_noise
from datagen.transforms.reindexing import structure
from shared_schema.checker import check_dataset
from shared_schema.common.errors import InputError
from shared_schema.manifest import read_manifest
from shared_schema.shard import read_shard

SHARD = "shard-00000.h5"


@pytest.fixture(scope="module")
def nodal(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("noise") / "nodal"
    run(read_case("beam2d_f1", samples=200), folder, comm=MPI.COMM_SELF)
    return folder


@pytest.fixture(scope="module")
def noisy(nodal: Path) -> Path:
    add_noise(nodal, nodal.parent / "noisy", seed=5)
    return nodal.parent / "noisy"


def test_definition(nodal: Path, noisy: Path) -> None:
    """‖f‖₂ ≤ 0.7 N: u → (1 + γ) u with γ ~ U(−0.2, 0.2); else u as it was."""
    before, after = read_shard(nodal / SHARD, "nodal"), read_shard(noisy / SHARD, "nodal")
    size = np.linalg.norm(before["samples/force"][:, 0], axis=1)
    u, v = before["samples/displacement"], after["samples/displacement"]
    factor = (u * v).sum(axis=(1, 2)) / (u * u).sum(axis=(1, 2))
    assert v == pytest.approx(u * factor[:, None, None], rel=1e-12)
    assert np.all(factor[size > 0.7] == 1)
    gamma = factor[size <= 0.7] - 1
    assert 30 < len(gamma) < 120  # π 0.7² / 4 = 38 % of 200
    assert np.abs(gamma).max() <= 0.2 + 1e-12
    assert gamma.std() == pytest.approx(0.2 / np.sqrt(3), rel=0.25)


def test_provenance(nodal: Path, noisy: Path) -> None:
    manifest = read_manifest(noisy)
    (step,) = manifest.transforms
    assert step["name"] == "noise"
    assert step["seed"] == 5
    assert step["source_digest"] == read_manifest(nodal).digest
    assert check_dataset(noisy) == []
    structure(noisy, noisy.parent / "grid")
    assert read_manifest(noisy.parent / "grid").transforms == manifest.transforms


def test_seed(nodal: Path, noisy: Path, tmp_path: Path) -> None:
    add_noise(nodal, tmp_path / "same", seed=5)
    add_noise(nodal, tmp_path / "other", seed=6)
    name = "samples/displacement"
    first, same, other = (
        read_shard(folder / SHARD, "nodal")[name]
        for folder in (noisy, tmp_path / "same", tmp_path / "other")
    )
    assert np.array_equal(first, same)
    assert not np.array_equal(first, other)


def test_refusals(nodal: Path, noisy: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--relative"):
        add_noise(nodal, tmp_path / "new", seed=0, relative=1.5)
    with pytest.raises(InputError, match="--threshold"):
        add_noise(nodal, tmp_path / "new", seed=0, threshold=float("nan"))
    with pytest.raises(InputError, match="holds another dataset"):
        add_noise(nodal, nodal, seed=0)
    with pytest.raises(InputError, match="holds another dataset"):
        add_noise(nodal, noisy, seed=6)
    assert not (tmp_path / "new").exists()
    assert check_dataset(nodal) == []
