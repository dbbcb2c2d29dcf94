from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.loading import load
from surrogate.learning.models.kinds import run_config
from surrogate.learning.networks.unet import UNet, UNetConfig
from surrogate.learning.probabilistic.stochastic_passes import ChannelDropout, Drawable, using
from surrogate.learning.training.loop import train


def generators(count: int) -> list[torch.Generator]:
    return [torch.Generator().manual_seed(t) for t in range(count)]


def test_nothing_is_dropped_in_evaluation() -> None:
    layer = ChannelDropout(4, 0.5).eval()
    x = torch.randn(3, 4, 5, 2)
    assert layer(x) is x


@pytest.mark.parametrize("grid", [(5, 2), (3, 2, 2)])
def test_whole_channels_of_every_sample_in_training(grid: tuple[int, ...]) -> None:
    """A share p of 200 · 50 masks is zero, to 4 √(p (1 − p) / 10⁴); the others are 1 / (1 − p)."""
    torch.manual_seed(0)
    masks = ChannelDropout(50, 0.2)(torch.ones(200, 50, *grid)).flatten(2)
    assert torch.equal(masks, masks[:, :, :1].expand_as(masks))
    assert set(masks.unique().tolist()) == {0.0, 1.25}
    assert (masks[..., 0] == 0).float().mean().item() == pytest.approx(0.2, abs=0.016)
    assert not torch.equal(masks[0], masks[1])


def test_passes_have_masks_of_their_own_and_samples_share_them() -> None:
    layer = ChannelDropout(40, 0.25).eval()
    assert isinstance(layer, Drawable)
    with using({layer: layer.draw(generators(3))}):
        y = layer(torch.ones(6, 40, 2, 2)).reshape(3, 2, 40, 4)
    assert torch.equal(y, y[:, :1, :, :1].expand_as(y))
    masks = y[:, 0, :, 0]
    assert not torch.equal(masks[0], masks[1])
    with using({layer: layer.draw(generators(3)[2:])}):
        assert torch.equal(layer(torch.ones(1, 40, 2, 2))[0, :, 0, 0], masks[2])
    assert torch.equal(layer(torch.ones(1, 40, 1, 1)), torch.ones(1, 40, 1, 1))


def test_mean_and_variance_over_passes() -> None:
    """m x with m ∈ {0, 1 / (1 − p)} has mean x and variance x² p / (1 − p)."""
    rate, count = 0.3, 20000
    layer = ChannelDropout(2, rate).eval()
    x = torch.tensor([1.0, -3.0]).reshape(1, 2, 1, 1)
    with using({layer: layer.draw(generators(count))}):
        y = layer(x.expand(count, 2, 1, 1)).reshape(count, 2)
    error = (rate / (1 - rate) / count) ** 0.5
    assert y.mean(dim=0).tolist() == pytest.approx([1, -3], abs=3 * 4 * error)
    variance = rate / (1 - rate)
    assert y.var(dim=0).tolist() == pytest.approx([variance, 9 * variance], rel=0.05)


def test_behind_the_second_convolution_of_every_level() -> None:
    """3 levels down and 2 up; none without a rate, and no change of the weights' names."""
    config = UNetConfig(channels=4, dropout=0.1)
    unet = UNet(2, 2, config)
    layers = [m for m in unet.modules() if isinstance(m, ChannelDropout)]
    assert [layer.channels for layer in layers] == [4, 8, 16, 8, 4]
    plain = UNet(2, 2, UNetConfig(channels=4))
    assert not any(isinstance(m, ChannelDropout) for m in plain.modules())
    assert list(plain.state_dict()) == list(unet.state_dict())


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, dataset: Dataset) -> Path:
    content = {
        "name": "dropout",
        "case": "beam2d",
        "network": {"levels": 2, "channels": 8, "batch_norm": False, "dropout": 0.2},
        "training": {"epochs": 2, "batch_size": 16},
    }
    folder = tmp_path_factory.mktemp("runs") / "dropout"
    config = run_config(content)
    train(config, dataset, folder, device="cpu")
    return folder


def test_prediction_is_the_mean_over_dropped_channels(run: Path, dataset: Dataset) -> None:
    """Compared with passes one by one; the whole standard deviation is epistemic."""
    surrogate = load(run)
    assert surrogate.is_probabilistic
    force = dataset.nodal_test.force
    found = surrogate.predict_distribution(force, passes=8, seed=3)
    single = [surrogate.predict_distribution(force, passes=t, seed=3).mean for t in range(1, 9)]
    totals = [t * mean for t, mean in enumerate(single, start=1)]
    passes = np.diff(totals, axis=0, prepend=0.0)
    np.testing.assert_allclose(found.mean, passes.mean(axis=0), atol=1e-7)
    np.testing.assert_allclose(found.std_epistemic, passes.std(axis=0, ddof=1), atol=1e-6)
    assert found.std_epistemic.max() > 1e-3
    assert not found.std_aleatoric.any()
