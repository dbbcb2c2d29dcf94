from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from shared_schema.checker import check_dataset
from shared_schema.shard import read_shard
from surrogate.learning.data.dataset import Dataset

# 60 samples, 12 of them for testing; they go to two shards alternately (see conftest.py).


def test_the_synthetic_datasets_keep_the_contract(data: Path, data_3d: Path) -> None:
    for folder in (data, data.parent / "nodal", data_3d, data_3d.parent / "nodal"):
        assert check_dataset(folder) == []


def test_shapes_and_split(dataset: Dataset, dataset_3d: Dataset) -> None:
    assert (len(dataset.train), len(dataset.test)) == (48, 12)
    assert dataset.train.force.shape == dataset.train.displacement.shape == (48, 2, 8, 4)
    assert dataset.test.force.dtype == torch.float32
    assert dataset_3d.test.displacement.shape == (12, 3, 8, 4, 4)
    assert dataset.info.grid_shape == (8, 4)
    assert dataset.geometry.cell_type == "quad"


def test_order_is_that_of_the_sample_numbers(data: Path, dataset: Dataset) -> None:
    shards = [read_shard(data / f"shard-0000{i}.h5", "structured") for i in range(2)]
    train: list[np.ndarray] = []
    test: list[np.ndarray] = []
    for number in range(60):  # sample 2k + i is number k of shard i
        shard, index = shards[number % 2], number // 2
        (test if shard["samples/is_test"][index] else train).append(shard["samples/force"][index])
    np.testing.assert_array_equal(dataset.train.force.numpy(), np.stack(train))
    np.testing.assert_array_equal(dataset.test.force.numpy(), np.stack(test))


def test_samples_are_taken_together(dataset: Dataset) -> None:
    taken = dataset.train[torch.tensor([5, 2])]
    assert len(taken) == 2
    assert torch.equal(taken.force[1], dataset.train.force[2])
    assert torch.equal(taken.displacement[0], dataset.train.displacement[5])
