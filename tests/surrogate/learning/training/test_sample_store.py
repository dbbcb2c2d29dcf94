from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.samples import Samples
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train
from surrogate.learning.training.sample_store import DeviceStore, HostStore, fits, store_samples
from tests.surrogate.resuming import trained, untimed

MakeConfig = Callable[..., UNetModel]
CPU = torch.device("cpu")
DEVICES: list[Any] = [
    CPU,
    pytest.param(
        torch.device("cuda"),
        marks=[
            pytest.mark.gpu,
            pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device"),
        ],
    ),
]


def numbered(count: int) -> Samples:
    return Samples(torch.arange(count).float()[:, None], -torch.arange(count).float()[:, None])


@pytest.mark.parametrize("store", [DeviceStore, HostStore])
@pytest.mark.parametrize("device", DEVICES, ids=str)
def test_batches_come_in_order(store: type[DeviceStore | HostStore], device: torch.device) -> None:
    samples = store(numbered(7), device)
    indices = torch.tensor([3, 1, 6, 0, 5, 2, 4], device=samples.home)
    batches = list(samples.batches(torch.split(indices, 3)))
    assert [batch.force.flatten().tolist() for batch in batches] == [[3, 1, 6], [0, 5, 2], [4]]
    assert [len(batch) for batch in batches] == [3, 3, 1]
    assert all(torch.equal(batch.displacement, -batch.force) for batch in batches)
    assert all(batch.force.device.type == device.type for batch in batches)
    assert list(samples.batches([])) == []


@pytest.mark.parametrize("device", DEVICES, ids=str)
def test_training_from_the_host_is_that_from_the_device(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, device: torch.device
) -> None:
    """Both trainings are equal on the CPU, bit for bit."""
    runs = []
    for location in ("device", "host"):
        run = RunFolder(tmp_path / location)
        train(make_config(epochs=3, samples_on=location), dataset, run.folder, device=device.type)
        runs.append(run)
    if device.type == "cpu":
        assert runs[0].model.read_bytes() == runs[1].model.read_bytes()
        assert untimed(runs[0]) == untimed(runs[1])
    for line, expected in zip(untimed(runs[1]), untimed(runs[0]), strict=True):
        assert line == pytest.approx(expected, rel=1e-3)


def test_automatic_choice_asks_for_free_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """100 samples of two float32 take 800 bytes, half of 1600."""
    cuda, samples = torch.device("cuda"), numbered(100)
    for free, expected in {1600: True, 1598: False}.items():
        monkeypatch.setattr(torch.cuda, "mem_get_info", lambda _, free=free: (free, 10**9))
        assert fits(samples, cuda) == expected
    assert fits(samples, CPU)
    assert isinstance(store_samples(samples, "auto", CPU), DeviceStore)
    assert isinstance(store_samples(samples, "host", CPU), HostStore)


def test_samples_that_do_not_fit_stay_on_the_host(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = trained(make_config(epochs=1), dataset, tmp_path / "plain")
    monkeypatch.setattr("surrogate.learning.training.sample_store.fits", lambda *_: False)
    lent = trained(make_config(epochs=1), dataset, tmp_path / "lent")
    assert plain.model.read_bytes() == lent.model.read_bytes()
