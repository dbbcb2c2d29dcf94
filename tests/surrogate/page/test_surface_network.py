"""The page of a large body: displacements of its surface from sizes of unit loads."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.loading import load
from surrogate.learning.training.loop import train
from surrogate.mechanics.statics.load import given_load
from surrogate.page import body
from surrogate.page.page import write_page
from surrogate.page.page_loads import page_loads
from surrogate.page.page_network import (
    PATCH,
    Rows,
    SurfaceNetwork,
    spread_places,
    surface_network,
    unit_loads,
)
from tests.surrogate.page.browser import OpenPage

pytestmark = pytest.mark.filterwarnings("ignore::surrogate.OutsideTrainingWarning")
LOADS = [
    {"family": "body_force", "range": [-0.3, 0.2]},
    {"family": "traction_patch", "range": [-2, 2], "radius": [0.5, 0.7]},
]
IN_SHORTS = 1e-4  # of the largest displacement


@pytest.fixture
def run(dataset_3d: Dataset, tmp_path: Path) -> Path:
    """A reduced network of a body under patches and its weight."""
    case = {**dataset_3d.manifest.case, "load": LOADS}
    manifest = dataset_3d.manifest.model_copy(update={"case": case})
    config = {
        "name": "small",
        "case": manifest.name,
        "model": "reduced",
        "network": {"input_modes": 4, "output_modes": 6, "width": 8, "series": [3]},
        "training": {"epochs": 2, "batch_size": 16},
    }
    train(config, replace(dataset_3d, manifest=manifest), tmp_path / "run", device="cpu")
    return tmp_path / "run"


def test_sums_of_unit_loads(run: Path) -> None:
    """The displacements of the surface are those that the surrogate predicts."""
    model = load(run)
    loads, nodes = page_loads(model), model.geometry.surface_nodes
    places = spread_places(model.geometry, nodes, 5)
    units = unit_loads(model.geometry, loads, places)
    assert len(units) == 3 * (1 + 5)
    sizes = np.random.default_rng(0).normal(size=(2, len(units)))
    expected = model.predict(np.einsum("nq,qai->nai", sizes, units))[:, nodes]
    with torch.no_grad():
        network = SurfaceNetwork(model, units, nodes).eval()
        found = network(torch.from_numpy(sizes).float())["displacement"].numpy()
    np.testing.assert_allclose(found, expected, atol=IN_SHORTS * np.abs(expected).max())


def test_unit_loads_are_those_of_a_command(run: Path) -> None:
    model = load(run)
    loads = page_loads(model)
    place = int(spread_places(model.geometry, model.geometry.surface_nodes, 1)[0])
    units = unit_loads(model.geometry, loads, np.array([place]))
    at = ",".join(map(str, model.geometry.coordinates[place]))
    given = given_load(model.geometry, f"{at},0.6:0,2,-1", body_force="3,0,0.5")
    sizes = np.array([3, 0, 0.5, 0, 2, -1])
    np.testing.assert_allclose(np.einsum("q,qai->ai", sizes, units), given.forces, atol=1e-13)


def test_places_lie_apart(run: Path) -> None:
    """Eight of them are the corners of a box, but for those that are clamped."""
    geometry = load(run).geometry
    places = spread_places(geometry, geometry.surface_nodes, 4)
    assert not geometry.clamped[places].any()
    x = geometry.coordinates[places]
    assert np.isin(x[:, 1:], (geometry.coordinates.min(0), geometry.coordinates.max(0))).all()
    everywhere = spread_places(geometry, geometry.surface_nodes, 10**6)
    assert set(everywhere) <= set(geometry.surface_nodes[geometry.loadable[geometry.surface_nodes]])


def test_rows_in_16_bits() -> None:
    matrix = torch.randn(3, 50) * torch.tensor([[1e-6], [1.0], [0.0]])
    found = Rows(matrix)(torch.eye(3))
    assert bool(((found - matrix).abs() <= matrix.abs().amax(dim=1, keepdim=True) / 2**15).all())


def test_as_many_places_as_fit(run: Path) -> None:
    model = load(run)
    loads, nodes = page_loads(model), model.geometry.surface_nodes
    row = 2 * 3 * len(nodes)
    weights = sum(p.nbytes for p in model.network.network.parameters())
    fixed = weights + (6 + 3) * row
    _, places = surface_network(model, loads, nodes, fixed + 2 * (3 * row + PATCH))
    assert len(places) == 2
    with pytest.raises(InputError, match="the network of the surface takes"):
        surface_network(load(run), loads, nodes, fixed)


@pytest.mark.browser
@pytest.mark.slow
def test_page_of_a_large_body(
    run: Path,
    open_page: Callable[..., OpenPage],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A drag acts about the nearest place; the copied command predicts the same."""
    monkeypatch.setattr(body, "BAND", 100)
    with pytest.raises(InputError, match="density: expected none"):
        write_page(run, tmp_path / "page.html", density=1.0)
    assert not write_page(run, tmp_path / "page.html").estimates
    model, page = load(run), open_page(tmp_path / "page.html")
    places = page.page.evaluate("surrogatePage.state.content.places")
    page.drag(places[-1], right=25, up=40)
    page.page.locator("#body-force input[type=number]").nth(2).fill("-0.15")
    page.settle()
    command = page.text("#panel code")
    texts = re.findall(r'--load="([^"]*)"', command)
    density = re.search(r'--body-force="([^"]*)"', command)
    assert density is not None
    forces = given_load(model.geometry, texts, body_force=density[1]).forces
    nodes = model.geometry.surface_nodes
    np.testing.assert_allclose(page.forces, forces[nodes], atol=1e-12)
    expected = model.predict(forces)[nodes]
    found = page.field("displacement")
    assert np.abs(found - expected).max() < 2 * IN_SHORTS * np.abs(expected).max()
