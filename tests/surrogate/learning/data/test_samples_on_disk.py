from __future__ import annotations

import os
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml

from shared_schema.common.errors import InputError
from surrogate.learning.data import samples_on_disk
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.data.samples_on_disk import SamplesOnDisk
from surrogate.learning.evaluation.run_evaluation import evaluate
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train
from surrogate.learning.training.sample_store import DiskStore, store_samples
from tests.surrogate.large_dataset import large_dataset
from tests.surrogate.resuming import assert_resumes, trained, untimed

CPU = torch.device("cpu")
MakeConfig = Callable[..., UNetModel]
SHARDS, SAMPLES = 30, 11  # with one test sample each
SHARD_BYTES = 11 * 2 * 2 * 8 * 4 * 4


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return large_dataset(tmp_path_factory.mktemp("large") / "data", SHARDS, SAMPLES)


@pytest.fixture
def dataset_on_disk(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Dataset:
    """A dataset of which six shards make a window."""
    monkeypatch.setattr(samples_on_disk, "WINDOW", 6 * SHARD_BYTES + 100)
    return read_dataset(folder, on_disk=True)


@pytest.fixture
def samples(dataset_on_disk: Dataset) -> SamplesOnDisk:
    assert isinstance(dataset_on_disk.training, SamplesOnDisk)
    assert dataset_on_disk.training.window == 6
    return dataset_on_disk.training


def seeded(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_samples_are_those_in_memory(samples: SamplesOnDisk, folder: Path) -> None:
    whole = read_dataset(folder)
    assert len(samples) == len(whole.train) == 300
    rows = torch.tensor([7, 299, 7, 0, 150])
    for found, expected in (
        (samples[rows], whole.train[rows]),
        (samples.in_memory(), whole.train),
        (samples.subset(rows)[1:3], whole.train[rows[1:3]]),
    ):
        assert torch.equal(found.force, expected.force)
        assert torch.equal(found.displacement, expected.displacement)


def test_order_is_random_within_a_window(samples: SamplesOnDisk) -> None:
    """Between the first and the last sample of a shard there are those of 6 shards before it and
    of 6 after it at most; the order of its own 10 samples is random."""
    order = samples.order(seeded(1))
    assert torch.equal(order.sort().values, torch.arange(300))
    assert torch.equal(order, samples.order(seeded(1)))
    assert not torch.equal(order, samples.order(seeded(2)))
    shard = order // 10
    spans, orders = [], set()
    for number in range(SHARDS):
        place = torch.nonzero(shard == number).flatten()
        spans.append(int(place[-1] - place[0]) + 1)
        orders.add(tuple((order[place] % 10).tolist()))
    assert max(spans) <= 10 * 12
    assert np.mean(spans) > 20  # mixed with others, not one shard after the other
    assert len(orders) > SHARDS - 3
    first = torch.tensor(sorted(set(shard[:60].tolist())))
    assert 3 < len(first) <= 12  # few shards at a time …
    assert not torch.equal(first, torch.arange(len(first)))  # … in a random order


@pytest.mark.parametrize("batch", [1, 16, 300])
def test_batches_hold_few_shards(
    samples: SamplesOnDisk, monkeypatch: pytest.MonkeyPatch, batch: int
) -> None:
    """Every shard is read once an epoch; at most a window and those ahead are in memory."""
    read: list[int] = []
    held: list[int] = []
    original, collect = SamplesOnDisk._shard, SamplesOnDisk._batch

    def counted(self: SamplesOnDisk, number: int) -> Any:
        read.append(number)
        return original(self, number)

    def watched(self: SamplesOnDisk, batch: Any, shards: Any, pinned: bool) -> Any:
        held.append(len(shards))
        return collect(self, batch, shards, pinned)

    monkeypatch.setattr(SamplesOnDisk, "_shard", counted)
    monkeypatch.setattr(SamplesOnDisk, "_batch", watched)
    whole, order = samples.in_memory(), samples.order(seeded(3))
    store = store_samples(samples, "disk", CPU)
    assert isinstance(store, DiskStore)
    found = list(store.batches(torch.split(order, batch)))
    assert torch.equal(torch.cat([b.force for b in found]), whole.force[order])
    assert torch.equal(torch.cat([b.displacement for b in found]), whole.displacement[order])
    assert sorted(read) == list(range(SHARDS))
    if batch < 300:
        assert max(held) <= 6 + 2 + samples_on_disk.AHEAD


def test_empty_shares_and_early_ends(samples: SamplesOnDisk) -> None:
    """As for the last of several processes in a small batch, and after a failed step."""
    shapes = [b.force.shape for b in samples.batches([torch.tensor([], dtype=torch.int64)], False)]
    assert shapes == [(0, 2, 8, 4)]
    batches = samples.batches(torch.split(torch.arange(300), 10), False)
    next(batches)
    del batches


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"ema": 0.9}, {"likelihood": "variational_bayes"}])
def test_training_resumes_bit_by_bit(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    make_config: MakeConfig,
    options: dict[str, object],
) -> None:
    """Seven shards, of which two make a window."""
    monkeypatch.setattr(samples_on_disk, "WINDOW", 2 * SHARD_BYTES + 100)
    dataset = read_dataset(large_dataset(tmp_path / "data", 7, SAMPLES), on_disk=True)
    config = make_config(epochs=4, samples_on="disk", **options)
    assert_resumes(config, dataset, tmp_path, stop_after=2)


def test_training_from_disk_learns_as_from_memory(
    data: Path, dataset: Dataset, tmp_path: Path, make_config: MakeConfig
) -> None:
    """The whole dataset is one window: only the order of the samples differs."""
    on_disk = trained(
        make_config(epochs=20, samples_on="disk"),
        read_dataset(data, on_disk=True),
        tmp_path / "disk",
    )
    memory = trained(make_config(epochs=20), dataset, tmp_path / "memory")
    found, expected = untimed(on_disk)[-1], untimed(memory)[-1]
    assert found["train_loss"] == pytest.approx(expected["train_loss"], rel=0.5)
    measured = [evaluate(run.folder, data).measures.mean_error for run in (on_disk, memory)]
    assert measured[0] == pytest.approx(measured[1], rel=0.5)


def test_place_of_the_samples_must_be_that_of_the_configuration(
    dataset_on_disk: Dataset, folder: Path, tmp_path: Path, make_config: MakeConfig
) -> None:
    run = RunFolder(tmp_path / "run")
    with pytest.raises(InputError, match="the samples are in memory, expected on disk"):
        train(make_config(samples_on="disk"), read_dataset(folder), run.folder, device="cpu")
    with pytest.raises(InputError, match="the samples are on disk, expected in memory"):
        train(make_config(), dataset_on_disk, run.folder, device="cpu")
    assert not run.folder.exists()


def test_a_shard_that_changes_during_the_training_is_refused(
    tmp_path: Path, make_config: MakeConfig
) -> None:
    folder = large_dataset(tmp_path / "data", 3, SAMPLES)
    dataset = read_dataset(folder, on_disk=True)
    os.utime(folder / "shard-00001.h5")
    with pytest.raises(InputError, match=r"shard-00001\.h5: changed during the training"):
        train(make_config(samples_on="disk"), dataset, tmp_path / "run", device="cpu")


@pytest.mark.slow
def test_reading_takes_little_more_than_what_is_kept(tmp_path: Path) -> None:
    """40 shards of 10 samples of 32 KiB: 12.5 MiB in all; test samples are kept by nodes as well,
    in double precision."""
    folder = large_dataset(tmp_path / "data", 40, 10, (64, 32), 5)
    tracemalloc.start()
    try:
        dataset = read_dataset(folder)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    parts = (dataset.train, dataset.test)
    tensors = [s for part in parts for s in vars(part).values() if s is not None]
    nodal = [a for a in vars(dataset.nodal_test).values() if a is not None]
    kept = sum(t.nbytes for t in tensors) + sum(a.nbytes for a in nodal)
    assert sum(t.nbytes for t in tensors) == 40 * 10 * 32 * 1024
    assert kept < peak < 1.2 * kept


LIMITED = """
import os, resource, shutil, sys
from surrogate.command_line import main
from surrogate.learning.data import samples_on_disk
samples_on_disk.WINDOW = 16 << 20
few, many, disk, auto = sys.argv[1:]
def train(config, data):
    return main(["train", config, "--device", "cpu", "--data", data, "--out", data + "-run"])
assert train(disk, few) == 0  # loads what torch needs
shutil.rmtree(few + "-run")
size = int(next(l for l in open("/proc/self/status") if l.startswith("VmSize")).split()[1]) << 10
resource.setrlimit(resource.RLIMIT_AS, (size + (220 << 20),) * 2)
assert train(auto, few) == 0  # what is small is read
assert train(auto, many) == 2
assert not os.path.exists(many + "-run")
sys.exit(train(disk, many))
"""

# Threads reserve no addresses for themselves, and freed blocks of a window go back at once.
ONE_HEAP = {"OMP_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "1", "MALLOC_MMAP_THRESHOLD_": "1048576"}


@pytest.mark.slow
def test_a_dataset_larger_than_the_memory(tmp_path: Path, make_config: MakeConfig) -> None:
    """256 MiB of samples in 64 shards; a process that may take 220 MiB more than without them."""
    few = large_dataset(tmp_path / "few", 1, 4, (128, 128))
    many = large_dataset(tmp_path / "many", 64, 16, (128, 128))
    for place in ("disk", "auto"):
        config = make_config(epochs=1, samples_on=place, validation_fraction=0.0)
        small = config.network.model_copy(update={"levels": 1, "channels": 2})
        content = yaml.safe_dump(config.model_copy(update={"network": small}).plain())
        (tmp_path / f"{place}.yaml").write_text(content)
    configs = (str(tmp_path / f"{place}.yaml") for place in ("disk", "auto"))
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(few), str(many), *configs],
        env=os.environ | ONE_HEAP,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    (refusal,) = (line for line in done.stderr.splitlines() if "error:" in line)
    assert "needs 0.25 GiB of memory at least, expected at most the 0." in refusal
    assert "'training.samples_on' = 'disk'" in refusal
    assert RunFolder(tmp_path / "many-run").is_finished
