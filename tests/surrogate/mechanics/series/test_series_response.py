"""Terms of the response against the series, its order, and networks around it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch
from torch import nn

from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.calibration import drawn_loads
from surrogate.learning.inference.export import export, load_exported
from surrogate.learning.inference.loading import load
from surrogate.learning.models.unet_model import UNetModel
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.equilibrium.linear_response import LinearResponse
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.series.compiled_series import in_threads
from surrogate.mechanics.series.series_response import SeriesResponse
from surrogate.mechanics.statics.load import Load
from surrogate.mechanics.statics.prediction import Series
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load, in_equilibrium, zoned
from tests.surrogate.mechanics.statics.test_cables import pulled
from tests.surrogate.resuming import assert_resumes, trained
from tests.surrogate.unet_configs import unet_config

SERIES = {"inputs": ["force", "linear_gradient", "last_gradient"], "skip": "series"}
KINDS: dict[str, dict[str, Any]] = {
    "deterministic": {},
    "mle": {"likelihood": "maximum_likelihood"},
    "vb": {"likelihood": "variational_bayes", "variational": {"convolutions": [2]}},
    "ensemble": {"ensemble": 2},
}


def config_of(dataset: Dataset, order: int = 3, **content: Any) -> UNetModel:
    """A small U-Net with the series, trained for four epochs."""
    network = {"levels": 2, "channels": 4, "series_order": order, **SERIES}
    training = {"epochs": 4, "batch_size": 8, "validation_fraction": 0.1}
    case = dataset.manifest.name
    return unet_config(case=case, network=network, training=training, **content)


@pytest.mark.parametrize("cell_type", ["quad", "tetra"])
def test_zones(cell_type: str) -> None:
    """The response on both ways to compute it, of zones of other Young's moduli."""
    geometry, materials = zoned(cell_type)
    body, response = Equilibrium(geometry, materials), SeriesResponse(geometry, materials, False, 5)
    load = end_load(geometry, *(1.0, -4.0, 2.0)[: geometry.dimension])
    series = body.linear_response(load[None])
    first = torch.from_numpy(series).transpose(1, 2)
    compiled, _ = response.beyond_first(first)
    response.series.compiled = False
    beyond, _ = response.beyond_first(first)
    torch.testing.assert_close(compiled, beyond, rtol=0, atol=1e-9 * np.abs(series).max())
    u = (first + beyond)[0].T.numpy()
    truth = correct(body, load, u, 1e-12).displacement
    assert np.abs(u - truth).max() < 2e-4 * np.abs(truth).max()
    assert np.abs(series[0] - truth).max() > 2e-2 * np.abs(truth).max()


def test_gradients_are_those_of_the_first_and_the_last_term() -> None:
    geometry = box("quad")
    response, linear = SeriesResponse(geometry, MATERIAL), LinearResponse(geometry, MATERIAL)
    force = torch.from_numpy(geometry.grid.forces_to_grid(end_load(geometry, 1.0, -4.0))).float()
    nodal = response.at_nodes(force[None])
    beyond, last = response.beyond_first(nodal)
    third = response.series.terms(nodal.mT)[0][2].mT
    ratio = float((last * third).sum() / third.square().sum())
    torch.testing.assert_close(last, ratio * third)
    assert 0.5 < ratio < 1.5
    displacement, gradient = response(force[None])
    torch.testing.assert_close(displacement, linear.on_grid((nodal + beyond).float())[0])
    torch.testing.assert_close(gradient[:, :4], linear.on_grid(nodal.float())[1])
    torch.testing.assert_close(gradient[:, 4:], linear.on_grid(last.float())[1])


@pytest.mark.parametrize("cell_type", ["quad", "hexahedron"])
def test_no_loads_have_no_responses(cell_type: str) -> None:
    """A validation split may be empty."""
    geometry = box(cell_type)
    force = torch.from_numpy(geometry.grid.forces_to_grid(0 * geometry.coordinates)).float()
    displacement, gradient = SeriesResponse(geometry, MATERIAL)(force[None][:0])
    assert displacement.shape == (0, *force.shape)
    assert gradient.shape == (0, 2 * len(force) ** 2, *force.shape[1:])


@pytest.mark.parametrize("order", [2, 3, 4, 6])
def test_remainder_is_of_the_next_order(order: int) -> None:
    """Equilibria at t and t / 2, by Newton's method: the remainders differ by about 2^(n+1)."""
    geometry = box("quad")
    equilibrium = Equilibrium(geometry, MATERIAL)
    response = SeriesResponse(geometry, MATERIAL, order=order)
    force = end_load(geometry, 1.5, -6.0)
    first = torch.from_numpy(equilibrium.linear_response(force[None])).transpose(1, 2)

    def remainder(t: float) -> float:
        series = (t * first + response.beyond_first(t * first)[0])[0].T.contiguous().numpy()
        u = correct(equilibrium, t * force, series, 1e-12).displacement
        return float(np.linalg.norm(u - series))

    ratio = remainder(1.0) / remainder(0.5)
    assert 0.6 < ratio / 2 ** (order + 1) < 1.7


def test_under_small_loads_the_second_term_is_what_is_beyond_the_first() -> None:
    geometry = box("hexahedron")
    response = SeriesResponse(geometry, MATERIAL)
    force = end_load(geometry, 1.0, -4.0, 2.0)
    first = torch.from_numpy(Equilibrium(geometry, MATERIAL).linear_response(force[None]))
    small = 1e-5 * first.transpose(1, 2)
    second = response.series.terms(small.mT)[0][1].mT
    torch.testing.assert_close(
        response.beyond_first(small)[0], second, rtol=0, atol=1e-3 * float(second.abs().max())
    )


@pytest.mark.parametrize("factor", [1.0, 1e-3, 1e-6, 0.0])
def test_large_bodies_respond_in_single_precision(
    factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    geometry = box("hexahedron")
    force = factor * geometry.grid.forces_to_grid(end_load(geometry, 1.0, -4.0, 2.0))
    grid_force = torch.from_numpy(force[None]).float()
    double = SeriesResponse(geometry, MATERIAL, order=4)
    expected = double.at_nodes(grid_force)
    expected = expected + double.beyond_first(expected)[0]
    monkeypatch.setattr("surrogate.mechanics.equilibrium.compliance.DENSE", 0)
    single = SeriesResponse(geometry, MATERIAL, order=4)
    first = single.at_nodes(grid_force)
    found = first + single.beyond_first(first)[0]
    assert found.dtype == torch.float32
    atol = 1e-6 * float(expected.abs().max())
    torch.testing.assert_close(found.double(), expected, rtol=0, atol=atol)


@pytest.mark.parametrize("kind", KINDS)
def test_k_and_k_epochs_are_2k(tmp_path: Path, dataset: Dataset, kind: str) -> None:
    config = config_of(dataset, **KINDS[kind])
    assert_resumes(config, in_equilibrium(dataset), tmp_path, stop_after=2)


@pytest.mark.slow
def test_saved_and_exported(tmp_path: Path, dataset: Dataset) -> None:
    config = config_of(dataset, order=2, **KINDS["mle"])
    run = trained(config, in_equilibrium(dataset), tmp_path / "run")
    model = load(run.folder)
    force = np.random.default_rng(0).normal(size=(3, *dataset.geometry.coordinates.shape))
    force[:, dataset.geometry.clamped] = 0
    expected = model.averaged_passes(force).fields()
    export(run.folder, tmp_path / "a.onnx", format="onnx")
    exported = load_exported(tmp_path / "a.onnx")(torch.from_numpy(force.astype(np.float32)))
    for name in ("displacement", "std"):
        scale = np.abs(expected[name]).max()
        np.testing.assert_allclose(exported[name].numpy(), expected[name], atol=1e-4 * scale)
    assert not scattered_sums(tmp_path / "a.onnx")


def scattered_sums(path: Path) -> list[str]:
    """Operations of a file that add at places that may be the same: ONNX Runtime loses some."""
    model = onnx.load(path)
    nodes = [*model.graph.node, *(node for function in model.functions for node in function.node)]
    assert "Loop" in {node.op_type for node in nodes}
    return [
        node.op_type
        for node in nodes
        for attribute in node.attribute
        if attribute.name == "reduction" and attribute.s not in (b"", b"none")
    ]


def test_a_network_of_zeros_is_the_series(dataset: Dataset) -> None:
    config = config_of(dataset)
    network = config.build(dataset.geometry, dataset.info, dataset.material).eval()
    config.start_from_data(network, dataset, dataset.train)
    for parameter in network.network.parameters():
        nn.init.zeros_(parameter)
    response = SeriesResponse(dataset.geometry, MATERIAL)
    expected, gradient = response(dataset.test.force)
    with torch.no_grad():
        torch.testing.assert_close(network(dataset.test.force).mean, expected)
    inputs, _ = network.inputs_of(dataset.train.force)
    assert inputs.shape[1] == 2 + 4 + 4
    assert float(inputs[:, 2:6].square().mean()) == pytest.approx(1, rel=1e-4)
    assert network.last_gradient == slice(6, 10)
    direction = network.scaled(inputs)[:, 6:]
    largest = direction.square().sum(dim=1).flatten(1).amax(dim=1)
    torch.testing.assert_close(largest, torch.ones(len(inputs)))
    amplitude = network.amplitude(inputs)
    torch.testing.assert_close(direction * amplitude, inputs[:, 6:])
    assert gradient.shape[1] == 8


@pytest.mark.slow
def test_large_bodies_and_their_exported_files(
    tmp_path: Path, dataset_3d: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without K⁻¹: the body solves with its factor, the file by block elimination."""
    monkeypatch.setattr("surrogate.mechanics.equilibrium.compliance.DENSE", 100)
    config = config_of(dataset_3d, order=2)
    run = trained(config, in_equilibrium(dataset_3d), tmp_path / "run")
    model = load(run.folder)
    force = 0.2 * np.random.default_rng(0).normal(size=(2, *dataset_3d.geometry.coordinates.shape))
    force[:, dataset_3d.geometry.clamped] = 0
    export(run.folder, tmp_path / "a.onnx", format="onnx")
    exported = load_exported(tmp_path / "a.onnx")(torch.from_numpy(force.astype(np.float32)))
    expected = model.predict(force)
    found = exported["displacement"].numpy()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("network", "part"),
    [
        ({"inputs": ["last_gradient"]}, "last_gradient: expected with skip 'series'"),
        ({"skip": "series"}, "expected linear_gradient and last_gradient with skip 'series'"),
        ({"skip": "cubic"}, "key 'network.skip' = 'cubic'"),
    ],
)
def test_wrong_keys_are_named(network: dict[str, Any], part: str) -> None:
    with pytest.raises(InputError, match=part):
        unet_config(network=network)


def test_any_number_of_threads_finds_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit: threads share loads, not sums."""
    model = load("lshape2d_any")
    forces = drawn_loads(model, 40, np.random.default_rng(3))
    one = model.predict(forces)
    monkeypatch.setattr(torch, "get_num_threads", lambda: 3)
    assert np.array_equal(model.predict(forces), one)


@pytest.mark.parametrize(
    ("loads", "least", "shares"), [(0, 1, 1), (1, 1, 1), (7, 1, 3), (7, 3, 2), (2, 8, 1)]
)
def test_threads_share_all_loads(
    loads: int, least: int, shares: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch, "get_num_threads", lambda: 3)
    parts: list[slice] = []
    in_threads(parts.append, loads, least)
    assert len(parts) == shares
    assert sorted(n for part in parts for n in range(part.start, part.stop)) == list(range(loads))


def test_tensions_are_told_on_the_grid() -> None:
    """Forces of a sample tell its tensions; the series is that which is given them."""
    body = pulled("quad", "linear")
    geometry = body.geometry
    response = SeriesResponse(geometry, body.material, False, 5)
    load = Load.of(geometry, actuate={"along": 9.0, "anchored": 3.0})
    at_rest = load.at_rest(geometry)
    beside = at_rest.copy()
    beside[np.flatnonzero(geometry.free.all(axis=1))[0]] += 1.0  # another force: none are told
    grids = np.stack([geometry.grid.forces_to_grid(f) for f in (at_rest, beside)])
    force = torch.from_numpy(grids).float()
    assert response.pressed is not None
    dead, tensions = response.pressed.told_apart(response.to_nodes(force.flatten(2)).double())
    assert tensions is not None
    np.testing.assert_allclose(tensions, [[9.0, 3.0], [0.0, 0.0]], atol=1e-4)
    assert not dead[0].any()
    assert dead[1].any()
    found = geometry.grid.to_nodes(response(force)[0][0].numpy())
    expected, _ = Series(body).respond(load)
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())
