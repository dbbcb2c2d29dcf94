"""Load paths: batches are samples moved by t U₁ + t² U₂; paths are computed once and kept."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from shared_schema.common.errors import InputError
from surrogate.contrib.sample_paths import (
    FOLDER,
    IN_A_FILE,
    AlongPaths,
    SamplePaths,
    compute_missing,
    read_paths,
)
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.data.mirror import with_mirror_images
from surrogate.learning.data.samples import Samples
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train
from surrogate.learning.training.sample_store import DeviceStore
from surrogate.mechanics.equilibrium.linear_response import LinearResponse
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from tests.surrogate.learning.data.test_mirror import symmetric
from tests.surrogate.resuming import CPU, assert_resumes

MakeConfig = Callable[..., UNetModel]


def test_every_sample_moves_along_one_of_its_paths() -> None:
    """ΔF is 1 + k in sample and path k, so that the moved force tells t; U = t + 10 t²."""
    count, paths = 200, 3
    shape = (count, paths, 2, 4, 3)
    rise = torch.arange(1.0, paths + 1).reshape(1, -1, 1, 1, 1).expand(shape)
    base = Samples(*(torch.zeros(count, 2, 4, 3) for _ in range(2)))
    known = SamplePaths(100 * rise, rise, 10 * rise)
    torch.manual_seed(0)
    store = AlongPaths(DeviceStore(base, CPU), known)
    batches = list(store.batches(torch.split(torch.randperm(count), 64)))
    assert [len(batch) for batch in batches] == [64, 64, 64, 8]
    force, u = (torch.cat([getattr(b, n) for b in batches]) for n in ("force", "displacement"))
    assert torch.equal(force, force[:, :1, :1, :1].expand(force.shape))
    found = set()
    for f, value in zip(force[:, 0, 0, 0].tolist(), u[:, 0, 0, 0].tolist(), strict=True):
        fits = [k for k in (1, 2, 3) if abs(k * (t := f / 100 / k) + 10 * k * t**2 - value) < 1e-4]
        assert fits
        found.update(fits)
    assert found == {1, 2, 3}
    assert force.min() < -200
    assert force.max() > 200


def test_paths_of_mirrored_samples(dataset_3d: Dataset) -> None:
    """Of linear elasticity: U₁ = K⁻¹ ΔF holds for the paths of the mirror images too."""
    geometry = symmetric(dataset_3d.geometry)
    response = LinearResponse(geometry, dataset_3d.material, gradient=False)
    change = torch.randn(2, 3, 3, *geometry.grid.shape)
    first = response(change.flatten(0, 1))[0].reshape(change.shape)
    paths = SamplePaths(change, first, 2 * first)
    both = paths.with_mirror_images(geometry, ("y", "z"), "mirrors")
    assert len(both) == 8
    assert torch.equal(both.force[:2], change)
    expected = response(both.force.flatten(0, 1))[0].reshape(both.first.shape)
    torch.testing.assert_close(both.first, expected, rtol=1e-3, atol=1e-5)
    torch.testing.assert_close(both.second, 2 * both.first)
    base = Samples(change[:, 0], first[:, 0])
    images = with_mirror_images(base, geometry, ("y", "z"), "mirrors")
    assert torch.equal(images.force, both.force[:, 0])  # in the order of the samples' images


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
        train(make_config(load_paths=count, epochs=1), data, run.folder, device="cpu")
        weights.append(run.read_tensors()["network.head.weight"])
    assert not torch.equal(*weights)


def test_samples_on_disk_have_no_paths(
    folder: Path, tmp_path: Path, make_config: MakeConfig
) -> None:
    data: Dataset = read_dataset(folder, on_disk=True)
    config = make_config(load_paths=2, samples_on="disk")
    with pytest.raises(InputError, match=r"'training.load_paths' = 2: expected 0 of samples on"):
        train(config, data, tmp_path / "run", device="cpu")
    assert not (tmp_path / "run").exists()
    assert not (folder / FOLDER).exists()
