from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.network_model import training_memory
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.networks.field_network import parameter_count

MakeConfig = Callable[..., UNetModel]


def test_by_hand(dataset: Dataset, make_config: MakeConfig) -> None:
    """One level of 8 channels on 8 × 4 points, padding 1: two convolutions, a head, batches of 3.

    Weights: 2·8·9 + 8, 8·8·9 + 8 and 8·2 + 2; each with its gradient and the two moments of Adam.
    Values: the padded input, the results of both convolutions, and those of both activations,
    which ReLU and the next convolution share.
    """
    config = make_config("adam")
    single = config.network.model_copy(update={"levels": 1})
    config = config.model_copy(update={"network": single})
    weights = (2 * 8 * 9 + 8) + (8 * 8 * 9 + 8) + (8 * 2 + 2)
    values = 3 * 10 * 6 * (2 + 8 + 8)
    assert training_memory(config, dataset.geometry, 3) == 4 * (4 * weights + values)


@pytest.mark.parametrize("change", [{"ema": 0.9}, {"early_stopping": {"patience": 2}}])
def test_copies_of_the_weights(
    dataset: Dataset, make_config: MakeConfig, change: dict[str, Any]
) -> None:
    """One more copy of all weights, in float32."""
    plain, more = (
        training_memory(make_config("adam", **options), dataset.geometry, 2)
        for options in ({}, change)
    )
    network = make_config().build(dataset.geometry, dataset.info)
    assert more - plain == 4 * parameter_count(network)
