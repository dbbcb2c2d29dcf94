"""The file of a page: what it contains, and what it refuses."""

from __future__ import annotations

import gzip
import inspect
import json
import re
from base64 import b64decode
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch

from shared_schema.common.errors import InputError
from surrogate.command_line import main
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.export import responses
from surrogate.learning.inference.loading import load
from surrogate.learning.runs.config_reader import read_config
from surrogate.learning.training.loop import train
from surrogate.mechanics.equilibrium.linear_response import LinearResponse
from surrogate.page import body, bundle
from surrogate.page import page as page_module
from surrogate.page.body import mechanics_of, spread_of
from surrogate.page.inlined import inlined, packed
from surrogate.page.page import write_page
from surrogate.page.page_network import fitting_passes, page_network
from tests.surrogate.learning.inference.test_export import embedded
from tests.surrogate.page.runs import LINEAR, untrained

BUNDLE = {"page.js": "let page;", "page.css": "body {}"}


@pytest.fixture
def small_bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A bundle that is there, whatever npm has built."""
    folder = tmp_path / "bundle"
    folder.mkdir()
    for name, text in BUNDLE.items():
        (folder / name).write_text(text)
    (folder / "runtime.wasm.gz").write_bytes(gzip.compress(b"wasm"))
    monkeypatch.setattr(bundle.read_bundle, "__defaults__", (folder,))
    return folder


def element(page: str, name: str) -> str:
    """Text of a script element."""
    found = re.search(rf'<script type="[^"]*" id="{name}">(.*?)</script>', page, re.DOTALL)
    assert found
    return found[1]


def test_page_contains_body_network_and_script(
    small_bundle: Path, dataset: Dataset, tmp_path: Path
) -> None:
    run = untrained(tmp_path / "run", dataset, dataset.geometry, LINEAR)
    path = tmp_path / "page.html"
    written = write_page(run, path)
    page = path.read_text()
    assert written.size == path.stat().st_size
    assert "let page;" in page
    assert gzip.decompress(b64decode(element(page, "runtime"))) == b"wasm"
    content: dict[str, Any] = json.loads(element(page, "content"))
    assert content["run"] == str(run)
    assert content["needsResponse"]
    law = content["body"]["laws"][0]
    assert (law["inputs"], len(law["outputs"])) == (4, 4)  # F and P in the plane
    assert content["limit"] == list(dataset.info.force.max_abs)
    assert content["loads"]["most"] == 1
    assert content["units"] == {"length": "m", "force": "N"}
    block = gzip.decompress(b64decode(element(page, "arrays")))
    place = content["arrays"]["coordinates"]
    found = np.frombuffer(block, place["type"], dataset.geometry.coordinates.size, place["offset"])
    np.testing.assert_array_equal(found, dataset.geometry.coordinates.ravel())
    network = onnx.load_from_string(gzip.decompress(b64decode(element(page, "network"))))
    assert [i.name for i in network.graph.input] == ["force", "response"]


@pytest.mark.parametrize("order", [1, 4])
def test_page_of_a_series_has_no_network(
    small_bundle: Path, dataset: Dataset, tmp_path: Path, order: int
) -> None:
    config = read_config("series", data=dataset, changes=[f"series_order={order}"])
    train(config, dataset, tmp_path / "run")
    written = write_page(tmp_path / "run", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    content = json.loads(element(page, "content"))
    assert (content["series"], content["needsResponse"]) == (order, False)
    assert element(page, "network") == element(page, "runtime") == ""
    assert written.estimates


def test_name_of_a_case_cannot_end_the_script(
    small_bundle: Path, dataset: Dataset, tmp_path: Path
) -> None:
    run = untrained(tmp_path / "a<b", dataset, dataset.geometry, {})
    write_page(run, tmp_path / "page.html")
    text = element((tmp_path / "page.html").read_text(), "content")
    assert "<" not in text
    assert json.loads(text)["run"] == str(run)


def test_response_of_a_force_on_an_embedded_grid(dataset: Dataset, tmp_path: Path) -> None:
    """K⁻¹ (Aᵀ Bᵀ f), by the spread that a page gets, is the network's own linear response."""
    geometry = embedded(dataset.geometry)
    model = load(untrained(tmp_path / "run", dataset, geometry, LINEAR))
    force = np.zeros(geometry.coordinates.shape)
    force[~geometry.clamped] = np.random.default_rng(0).normal(size=(~geometry.clamped).sum())[
        :, None
    ]
    spread = spread_of(geometry).T @ force
    found = model.body.equilibrium.linear_response(spread[None])[0]
    assert isinstance(model.network.linear, LinearResponse)
    expected = responses(model, torch.from_numpy(force[None].astype(np.float32)))[0].numpy()
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_network_too_large_for_the_page(
    small_bundle: Path,
    dataset: Dataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = untrained(tmp_path / "run", dataset, dataset.geometry, {"channels": 64})
    with pytest.raises(InputError, match=r"the network takes \S+ MB, expected \S+ MB at most"):
        write_page(run, tmp_path / "page.html", largest=400_000)
    defaults = inspect.unwrap(write_page).__kwdefaults__
    monkeypatch.setitem(defaults, "largest", 400_000)
    assert main(["page", str(run), "--out", str(tmp_path / "page.html")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (tmp_path / "page.html").exists()


def test_body_too_large_for_a_series_on_the_page(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    series = {"inputs": ["force", "linear_gradient", "last_gradient"], "skip": "series"}
    run = untrained(tmp_path / "run", dataset, dataset.geometry, series)
    monkeypatch.setattr("surrogate.mechanics.equilibrium.compliance.DENSE", 10)
    with pytest.raises(InputError, match="the network's load series needs a body of at most"):
        page_network(load(run), 10**7)


def test_passes_that_fit(dataset: Dataset, tmp_path: Path) -> None:
    content: dict[str, Any] = {"likelihood": "variational_bayes", "variational": {}, "ensemble": 2}
    run = untrained(tmp_path / "run", dataset, dataset.geometry, {}, **content)
    model = load(run)
    plenty, weights = fitting_passes(model, 0, 10**9)
    assert plenty == 30 // 2
    drawn = (weights - fitting_passes(model, 0, 0)[1]) // (plenty - 2)
    assert fitting_passes(model, 0, weights - 1)[0] == plenty - 1
    assert fitting_passes(model, 0, weights - 3 * drawn)[0] == plenty - 3
    with pytest.raises(InputError, match=r"MB with 2 passes, expected 0\.0 MB at most"):
        page_network(model, 1000)


def test_body_too_large_for_the_page(
    small_bundle: Path, dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A U-Net with the linear response is refused; without, the page has no estimates."""
    linear = load(untrained(tmp_path / "linear", dataset, dataset.geometry, LINEAR))
    plain = load(untrained(tmp_path / "plain", dataset, dataset.geometry, {}))
    assert mechanics_of(plain).body is not None
    monkeypatch.setattr(body, "BAND", 100)
    assert mechanics_of(plain).body is None
    assert mechanics_of(linear).band == 672
    monkeypatch.setattr(page_module, "BAND", 100)
    with pytest.raises(InputError, match="a band of 672 entries, expected 100 at most, or a"):
        write_page(tmp_path / "linear", tmp_path / "page.html")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["beam2d_any", "--out", "page.txt"], "expected a file name ending in .html"),
        (["beam2d_any", "--patch", "-1", "--out", "page.html"], "expected a finite radius in m"),
        (["beam2d_any", "--patch", "nan", "--out", "page.html"], "expected a finite radius in m"),
        (["no-such-run", "--out", "page.html"], "no run there"),
        (["beam2d_any", "--out", "nowhere/page.html"], "no such folder"),
    ],
)
def test_wrong_input_gets_one_line(
    small_bundle: Path,
    arguments: list[str],
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["page", *arguments]) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert expected in error
    assert list(tmp_path.glob("*.html")) == []


def test_command(
    small_bundle: Path, dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = untrained(tmp_path / "run", dataset, dataset.geometry, {})
    path = tmp_path / "page.html"
    assert main(["page", str(run), "--out", str(path)]) == 0
    assert capsys.readouterr().out.startswith(f"{path}: ")
    assert "let page;" in path.read_text()


def test_checkout_without_bundle_says_how_to_build_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bundle.read_bundle, "__defaults__", (tmp_path / "bundle",))
    assert main(["page", "beam2d_any", "--out", str(tmp_path / "page.html")]) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert f"cd {tmp_path / 'web'} && npm ci && npm run build (or make setup)" in error


def test_arrays_are_aligned_and_inlined_reproducibly() -> None:
    arrays = {"a": np.arange(3, dtype=np.uint8), "b": np.array([[1.5, -2.0]])}
    table, block = packed(arrays)
    assert table["b"] == {"type": "float64", "shape": [1, 2], "offset": 8}
    np.testing.assert_array_equal(np.frombuffer(block, "<f8", 2, 8), [1.5, -2.0])
    assert gzip.decompress(b64decode(inlined(block))) == block
    assert inlined(block) == inlined(block)


def test_run_that_needs_no_response_has_one_input(
    small_bundle: Path, dataset: Dataset, tmp_path: Path
) -> None:
    model = load(untrained(tmp_path / "run", dataset, dataset.geometry, {}))
    network = onnx.load_from_string(page_network(model, 10**6).content)
    assert [i.name for i in network.graph.input] == ["force"]
