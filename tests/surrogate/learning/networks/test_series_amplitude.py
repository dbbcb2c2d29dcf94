"""The size of a network's output on a load series, on embedded grids with a share of K⁻¹f.

There the force of a node acts on the nodes around, too, so that a part of what the series leaves
over is linear in the load, and not of the order of its last term.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.samples import Samples
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.networks.field_network import FieldNetwork, share_of_linear
from tests.surrogate.learning.data.test_embedded_dataset import averaging
from tests.surrogate.learning.inference.test_predictor import (
    SERIES,
    assert_same_alone,
    loads,
    untrained,
)
from tests.surrogate.unet_configs import unet_config

LAST = torch.tensor([1e-6, 1e-3, 0.1, 1.0, 2.0])  # of loads from small to large
LINEAR = torch.tensor([0.01, 0.1, 0.4, 1.0, 1.2])


def test_the_share_is_found() -> None:
    """Sizes last + s · linear, with a power of two times the median ratio 0.25 for s; or none."""
    for share in (0.0, 0.25 / 32, 0.25 * 8):
        found = share_of_linear(3e-4 * (LAST + share * LINEAR), LAST, LINEAR)
        assert float(found) == pytest.approx(share)
    nothing = torch.zeros(5)
    assert float(share_of_linear(nothing, nothing, nothing)) == 0


def of(dataset: Dataset, samples: Samples) -> FieldNetwork:
    network = {"levels": 2, "channels": 4, **SERIES}
    config = unet_config(case=dataset.manifest.name, network=network, displacement_scale="node")
    built = config.build(dataset.geometry, dataset.info, dataset.material)
    config.start_from_data(built, dataset, samples)
    return built


def test_small_loads_are_as_large_as_others_in_their_unit(dataset: Dataset) -> None:
    """Solutions of the series and 1 % of K⁻¹f: in units of the last term alone, small loads would
    have the errors that count, 10⁴ times those of large loads (load 10⁻², order 3)."""
    geometry = replace(dataset.geometry, grid=averaging(dataset.geometry.grid))
    other = replace(dataset, geometry=geometry)
    force = dataset.train.force[:20] * torch.logspace(-2, 0, 20)[:, None, None, None]
    network = of(other, replace(dataset.train[:20], force=force))
    assert network.linear is not None
    _, series = network.inputs_of(force)
    assert series is not None
    linear = network.linear.on_grid(network.linear.at_nodes(force))[0]
    solved = series + 0.01 * linear
    network = of(other, Samples(force, solved))
    prepared = network.prepared(Samples(force, solved))
    sizes = prepared.displacement.flatten(1).abs().mean(dim=1)
    ratios = sizes / network.amplitude(prepared.force).flatten()
    assert float(ratios.max() / ratios.min()) < 30
    last = network.largest(prepared.force, "last_gradient").flatten()
    assert float((sizes / last).max() / (sizes / last).min()) > 1e3


def test_grids_of_nodes_have_the_last_term_alone(dataset: Dataset) -> None:
    network = of(dataset, dataset.train)
    assert "linear_share" not in network.state_dict()
    inputs, _ = network.inputs_of(dataset.test.force)
    last = network.largest(inputs, "last_gradient")
    torch.testing.assert_close(network.amplitude(inputs), last, rtol=0, atol=0)


def test_one_load_and_runs_without_the_share(dataset: Dataset) -> None:
    """Alone and in a batch; weights of a run without a share are read as with a share 0."""
    model = untrained(dataset, averaging(dataset.geometry.grid), network=SERIES)
    network, force = model.network, loads(dataset)
    state = network.state_dict()
    assert network.linear_share is not None
    predicted = []
    for share in (0.5, 0.0):
        network.linear_share.fill_(share)
        model = Surrogate(network, model.geometry, model.description)
        assert_same_alone(model, dataset)
        predicted.append(model.predict(force))
    assert np.abs(predicted[0] - predicted[1]).max() > 1e-4 * np.abs(predicted[1]).max()
    network.linear_share.fill_(0.5)
    del state["linear_share"]
    network.load_state_dict(state)
    np.testing.assert_array_equal(
        Surrogate(network, model.geometry, model.description).predict(force), predicted[1]
    )
