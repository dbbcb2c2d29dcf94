"""Load paths are computed once, kept beside the dataset, and learned from."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from shared_schema.common.errors import InputError
from surrogate.data.dataset import Dataset, read_dataset
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.models.unet_model import UNetModel
from surrogate.runs.folder import RunFolder
from surrogate.training.kept_load_paths import FOLDER, IN_A_FILE, compute_missing, read_paths
from surrogate.training.train import train
from tests.surrogate.resuming import CPU, assert_resumes

MakeConfig = Callable[..., UNetModel]


@pytest.fixture
def folder(tmp_path: Path, make_dataset: Callable[..., Path]) -> Path:
    return make_dataset(tmp_path / "data")


def files(folder: Path) -> list[Path]:
    return sorted((folder / FOLDER).iterdir())


def test_paths_of_samples(folder: Path) -> None:
    """The first coefficient solves K(u) u₁ = Δf on the grid; chosen rows are those of all."""
    data = read_dataset(folder)
    all_rows = torch.arange(len(data.train))
    compute_missing(data, all_rows, 2)
    assert len(files(folder)) == -(-len(all_rows) // IN_A_FILE)
    paths, rows = read_paths(data, all_rows, 2), torch.tensor([3, 17, 40])
    some = read_paths(data, rows, 2)
    assert torch.equal(some.first, paths.first[rows])
    grid, equilibrium = data.geometry.grid, Equilibrium(data.geometry, data.material)
    samples = data.nodal_train(rows)
    for place in range(len(rows)):
        respond = equilibrium.response_at(samples.displacement[place])
        assert respond is not None
        change = grid.to_nodes(some.force[place].double().numpy())
        assert change.any()
        expected = torch.from_numpy(grid.to_grid(respond(change))).float()
        torch.testing.assert_close(some.first[place], expected, rtol=1e-4, atol=1e-6)


def test_files_are_made_once_and_by_need(folder: Path) -> None:
    data, rows = read_dataset(folder), torch.arange(10)
    compute_missing(data, rows, 1)
    (made,) = files(folder)
    before = made.stat().st_mtime_ns
    compute_missing(data, rows[2:5], 1)
    assert made.stat().st_mtime_ns == before
    compute_missing(data, rows, 2)
    assert len(files(folder)) == 2
    content = bytearray(made.read_bytes())
    content[-3] ^= 1
    made.write_bytes(bytes(content))
    with pytest.raises(InputError, match="damaged"):
        read_paths(data, rows, 1)


@pytest.mark.parametrize(
    "recipe",
    [
        {"mirrors": ()},
        {"likelihood": "variational_bayes", "variational": {"posterior_std": "gauss_newton"}},
    ],
    ids=["deterministic", "variational"],
)
def test_training_along_paths_resumes(
    folder: Path, tmp_path: Path, make_config: MakeConfig, recipe: dict[str, Any]
) -> None:
    config = make_config(load_paths=2, **recipe)
    assert_resumes(config, read_dataset(folder), tmp_path, 2)


def test_training_along_paths_differs(
    folder: Path, tmp_path: Path, make_config: MakeConfig
) -> None:
    data, weights = read_dataset(folder), []
    for count in (0, 2):
        run = RunFolder(tmp_path / str(count))
        train(make_config(load_paths=count, epochs=1), data, run, CPU)
        weights.append(run.read_tensors()["network.head.weight"])
    assert not torch.equal(*weights)


def test_samples_on_disk_have_no_paths(
    folder: Path, tmp_path: Path, make_config: MakeConfig
) -> None:
    data: Dataset = read_dataset(folder, on_disk=True)
    config = make_config(load_paths=2, samples_on="disk")
    with pytest.raises(InputError, match=r"'training.load_paths' = 2: expected 0 of samples on"):
        train(config, data, RunFolder(tmp_path / "run"), CPU)
    assert not (tmp_path / "run").exists()
    assert not (folder / FOLDER).exists()
