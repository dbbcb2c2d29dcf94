"""Predictions at some nodes, and columns of the compliance for loads on some nodes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

import surrogate
from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.touched_region import compliance_of
from surrogate.learning.runs.folder import RunFolder
from surrogate.mechanics.equilibrium import compliance

pytestmark = pytest.mark.filterwarnings("ignore::surrogate.OutsideTrainingWarning")


@pytest.fixture
def as_large(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bodies have too many degrees of freedom for dense matrices."""
    monkeypatch.setattr(compliance, "DENSE", 0)


@pytest.fixture
def reduced(dataset: Dataset, tmp_path: Path, as_large: None) -> surrogate.Surrogate:
    config = {
        "name": "small",
        "case": dataset.manifest.name,
        "model": "reduced",
        "network": {"input_modes": 4, "output_modes": 6, "width": 8},
        "training": {"epochs": 2, "batch_size": 16},
    }
    return surrogate.train(config, dataset, tmp_path / "run", device="cpu")


def loads(model: surrogate.Surrogate, *shape: int) -> np.ndarray:
    force = np.random.default_rng(0).normal(size=(*shape, *model.geometry.coordinates.shape))
    return np.asarray(force * model.geometry.free)


def test_some_nodes_of_a_reduced_network(reduced: surrogate.Surrogate) -> None:
    """They are those among all."""
    wanted = np.array([5, 31, 8])
    for force in (loads(reduced), loads(reduced, 3), loads(reduced, 0)):
        expected = reduced.predict(force)[..., wanted, :]
        found = reduced.predict(force, nodes=wanted)
        size = np.abs(expected).max(initial=0)
        np.testing.assert_allclose(found, expected, rtol=0, atol=3e-6 * size)
    surface = reduced.predict(loads(reduced), nodes="surface")
    assert surface.shape == (len(reduced.geometry.nodes_of("surface")), 2)


def test_some_nodes_of_any_network(trained: Path) -> None:
    model = surrogate.load(trained)
    force, wanted = loads(model, 2), [7, 9]
    np.testing.assert_array_equal(
        model.predict(force, nodes=wanted), model.predict(force)[:, wanted]
    )
    tensor = torch.from_numpy(force).requires_grad_()
    found = model.predict(tensor, nodes=wanted)
    assert found.shape == (2, 2, 2)
    assert found.requires_grad
    driven = model.predict(force[0], tolerance=0.1, nodes=wanted)
    np.testing.assert_array_equal(driven, model.predict(force[0], tolerance=0.1)[wanted])


def test_nodes_of_the_surface_of_a_plane_body(trained: Path) -> None:
    """8 × 4 nodes, of which 20 lie on the boundary."""
    x = surrogate.load(trained).geometry
    on_edge = (
        (x.coordinates == x.coordinates.min(0)) | (x.coordinates == x.coordinates.max(0))
    ).any(1)
    np.testing.assert_array_equal(x.nodes_of("surface"), np.flatnonzero(on_edge))


@pytest.mark.parametrize(
    ("nodes", "message"),
    [
        ("lid", "nodes 'lid': no such group, expected one of surface"),
        ([1, 32], "nodes: expected numbers from 0 to 31"),
        ([-1], "nodes: expected numbers from 0 to 31"),
        ([3, 3], "nodes: expected each number once"),
        ([0.5], "nodes: expected whole numbers in a row, or the name of a group"),
        ([[1]], "nodes: expected whole numbers in a row, or the name of a group"),
    ],
)
def test_nodes_that_are_none(trained: Path, nodes: object, message: str) -> None:
    model = surrogate.load(trained)
    with pytest.raises(InputError, match=message):
        model.predict(loads(model), nodes=nodes)  # type: ignore[call-overload]


def test_prepared_nodes_cost_no_solve(
    reduced: surrogate.Surrogate, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor do they in a model that is loaded from the run again; predictions are the same."""
    assert reduced.folder is not None
    monkeypatch.setattr("surrogate.mechanics.equilibrium.kept_responses.LOADED", 0)
    force = np.zeros(reduced.geometry.coordinates.shape)
    force[20:26] = loads(reduced)[20:26]
    expected = reduced.predict(force)
    reduced.prepare(np.arange(18, 28))
    again = surrogate.load(reduced.folder)
    for model in (reduced, again):
        monkeypatch.setattr(compliance_of(model), "solve", None)
        found = model.predict(force)
        np.testing.assert_allclose(found, expected, rtol=0, atol=3e-6 * np.abs(expected).max())
        with pytest.raises(TypeError):
            model.predict(loads(model))


def test_damaged_columns_are_refused(reduced: surrogate.Surrogate) -> None:
    reduced.prepare()
    path = RunFolder(reduced.run.folder).columns
    content = bytearray(path.read_bytes())
    content[-5] ^= 1
    path.write_bytes(bytes(content))
    with pytest.raises(InputError, match=r"columns\.safetensors: damaged"):
        surrogate.load(reduced.run.folder)


def test_what_cannot_be_prepared(trained: Path) -> None:
    """A U-Net of forces alone; a small body has all columns, and nothing is written."""
    with pytest.raises(InputError, match="begins with the linear response or the load series"):
        surrogate.load(trained).prepare()
    small = surrogate.load("lshape2d_any")
    small.prepare()
    assert small.folder is not None
    assert not RunFolder(small.folder).columns.exists()
