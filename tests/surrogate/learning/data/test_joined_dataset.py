"""Two datasets of one body, joined."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from shared_schema.common.errors import InputError
from shared_schema.manifest import ComponentStatistics
from surrogate.command_line import main
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.joined_dataset import pooled, read_dataset
from surrogate.learning.inference.loading import load


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory, make_dataset: Callable[..., Path]) -> Path:
    return make_dataset(tmp_path_factory.mktemp("other"), seed=5)


def test_training_splits_are_joined(data: Path, other: Path, dataset: Dataset) -> None:
    joined, second = read_dataset(data, other), read_dataset(other)
    assert torch.equal(joined.train.force[: len(dataset.train)], dataset.train.force)
    assert torch.equal(joined.train.force[len(dataset.train) :], second.train.force)
    assert torch.equal(joined.test.force, dataset.test.force)
    displacement = joined.train.displacement.flatten(2)[:, :, dataset.geometry.grid.mask.ravel()]
    values = displacement.transpose(1, 2).reshape(-1, 2).double().numpy()
    info = joined.info.displacement
    np.testing.assert_allclose(info.mean, values.mean(axis=0), atol=1e-6)
    np.testing.assert_allclose(info.std, values.std(axis=0), rtol=1e-5)
    np.testing.assert_allclose(info.max_abs, np.abs(values).max(axis=0), rtol=1e-6)
    assert (joined.info.train, joined.info.test) == (96, dataset.info.test)
    assert joined.manifest.digest not in (dataset.manifest.digest, second.manifest.digest)


def test_pooled_statistics() -> None:
    """1, 3 and 5: mean 3, variance 8/3; of the parts (1, 3) and (5,): 2, 1 and 5, 0."""
    parts = [
        ComponentStatistics(mean=(2.0,), std=(1.0,), max_abs=(3.0,)),
        ComponentStatistics(mean=(5.0,), std=(0.0,), max_abs=(5.0,)),
    ]
    found = pooled(parts, np.array([2, 1]))
    assert found.mean == pytest.approx((3.0,))
    assert found.std == pytest.approx(((8 / 3) ** 0.5,))
    assert found.max_abs == (5.0,)


def test_another_body_is_refused(data: Path, data_3d: Path) -> None:
    with pytest.raises(InputError, match="joined with"):
        read_dataset(data, data_3d)


def test_several_stay_in_memory(data: Path, other: Path) -> None:
    with pytest.raises(InputError, match="2 datasets, expected one"):
        read_dataset(data, other, on_disk=True)


def test_train_with_two_datasets(data: Path, other: Path, trained: Path, tmp_path: Path) -> None:
    """The run is resumed with the same two datasets only."""
    config = tmp_path / "config.yaml"
    config.write_text(
        f"{{name: small, case: {load(trained).description.run.case}, likelihood: "
        "deterministic, network: {levels: 2, channels: 4, padding: 1}, "
        "training: {epochs: 1, batch_size: 16}}"
    )
    command = ["train", str(config), "--data", str(data), "--data", str(other)]
    assert main([*command, "--out", str(tmp_path / "run")]) == 0
    assert load(tmp_path / "run").description.data.info.train == 96
    assert main([*command[:4], "--out", str(tmp_path / "run")]) == 2
