"""Exported files are loaded by onnxruntime and PyTorch, without code of this project."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import pytest
import torch
from numpy.typing import NDArray
from torch import nn

import surrogate.learning.inference.export
from shared_schema.common.errors import InputError, WorkError
from shared_schema.grid import Grid
from shared_schema.layout import NO_NODE
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.export import Format, export
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.probabilistic.likelihoods import Likelihood
from surrogate.learning.runs.description import describe
from surrogate.learning.runs.folder import RunFolder
from surrogate.mechanics.body.geometry import Geometry
from tests.surrogate.unet_configs import unet_config

Array = NDArray[np.float64]
SLOW_ONNX = ["pt2", pytest.param("onnx", marks=pytest.mark.slow)]


def permuted(geometry: Geometry) -> Geometry:
    """Return the geometry with nodes in random order, and a grid column without nodes."""
    shape = (geometry.grid.shape[0] + 1, *geometry.grid.shape[1:])
    node_at = np.full(shape, NO_NODE)
    nodes = np.random.default_rng(0).permutation(len(geometry.coordinates))
    node_at[:-1] = nodes.reshape(geometry.grid.shape)
    return replace(geometry, grid=Grid.of_nodes(node_at))


def embedded(geometry: Geometry) -> Geometry:
    """Return the geometry on a grid that maps each node to four grid points."""
    rng, nodes = np.random.default_rng(0), len(geometry.coordinates)
    points = np.stack([rng.permutation(35)[:4] for _ in range(nodes)])
    sources = rng.integers(0, nodes, (7, 5, 2))
    weights = np.full((7, 5, 2), 0.5), rng.dirichlet(np.ones(4), nodes)
    return replace(geometry, grid=Grid(sources, weights[0], points, weights[1]))


def untrained(
    folder: Path, dataset: Dataset, likelihood: Likelihood, geometry: Geometry, **network: Any
) -> Path:
    """Write a run with random weights; running statistics of batch norm are not 0 and 1."""
    posterior: dict[str, Any] = {}
    if likelihood == "variational_bayes":
        posterior["variational"] = {"biases": True, "initial_std": 0.05}
    config = unet_config(
        name="small",
        case=dataset.manifest.name,
        likelihood=likelihood,
        network={"levels": 2, "channels": 4, "padding": 1, **network},
        **posterior,
    )
    description = describe(config, dataset)
    model = description.run.build(geometry, description.data.info)
    for module in model.modules():
        if isinstance(module, nn.BatchNorm2d | nn.BatchNorm3d):
            nn.init.normal_(module.running_mean)  # type: ignore[arg-type]
            nn.init.uniform_(module.running_var, 0.5, 2.0)  # type: ignore[arg-type]
    run = RunFolder(folder)
    run.start(description)
    run.write_tensors({**model.state_dict(), **geometry.tensors()})
    return folder


@pytest.fixture(scope="module")
def deterministic(tmp_path_factory: pytest.TempPathFactory, dataset: Dataset) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "det"
    return untrained(folder, dataset, "deterministic", permuted(dataset.geometry))


@pytest.fixture(scope="module")
def bayes(tmp_path_factory: pytest.TempPathFactory, dataset: Dataset) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "vb"
    return untrained(folder, dataset, "variational_bayes", embedded(dataset.geometry))


def run_file(path: Path, forces: Array) -> dict[str, Array]:
    """Return the named fields that an exported file computes from forces (N, n_nodes, d)."""
    force = forces.astype(np.float32)
    if path.suffix == ".pt2":
        fields = torch.export.load(path).module()(torch.from_numpy(force))
        return {name: field.numpy() for name, field in fields.items()}
    session = onnxruntime.InferenceSession(path)
    assert [i.name for i in session.get_inputs()] == ["force"]
    names = [output.name for output in session.get_outputs()]
    return dict(zip(names, session.run(None, {"force": force}), strict=True))


def some_forces(model: Surrogate, samples: int) -> Array:
    shape = (samples, *model.geometry.coordinates.shape)
    free = ~model.geometry.clamped[:, None]
    return np.random.default_rng(samples).normal(size=shape) * free


def assert_same(found: dict[str, Array], expected: dict[str, Array]) -> None:
    """Require equality to float32 round-off, relative to the largest value of a field."""
    assert list(found) == list(expected)
    for name, field in expected.items():
        assert found[name].shape == field.shape
        np.testing.assert_allclose(
            found[name], field, rtol=0, atol=2e-5 * np.abs(field).max(), err_msg=name
        )


@pytest.mark.parametrize("kind", SLOW_ONNX)
def test_deterministic(deterministic: Path, tmp_path: Path, kind: Format) -> None:
    """The grid is permuted and padded; the batch sizes differ from that of the export."""
    path = tmp_path / f"model.{kind}"
    assert export(deterministic, path, format=kind) < 1e-5
    model = load(deterministic)
    for samples in (1, 2, 33):
        forces = some_forces(model, samples)
        assert_same(run_file(path, forces), {"displacement": model.predict(forces)})
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["onnx", "pt2"])
def test_stochastic_passes(bayes: Path, tmp_path: Path, kind: Format) -> None:
    """The file gives the distribution of the same seed's passes, on an embedded grid."""
    path = tmp_path / f"model.{kind}"
    assert export(bayes, path, format=kind, passes=6, seed=3) < 1e-4
    model = load(bayes)
    for samples in (1, 5):
        forces = some_forces(model, samples)
        found = run_file(path, forces)
        assert_same(found, model.predict_distribution(forces, passes=6, seed=3).fields())
    other = model.predict_distribution(forces, passes=6, seed=4)
    assert np.abs(found["displacement"] - other.mean).max() > 0.01 * np.abs(other.mean).max()


def test_mean_weights(bayes: Path, tmp_path: Path) -> None:
    """The file gives the means and standard deviations of the network with mean weights."""
    path = tmp_path / "model.pt2"
    export(bayes, path, format="pt2")
    model = load(bayes)
    forces = some_forces(model, 3)
    with torch.no_grad():
        mean, std = model.predictor.network(torch.from_numpy(forces.astype(np.float32)))
    assert std is not None
    assert_same(run_file(path, forces), {"displacement": mean[0].numpy(), "std": std[0].numpy()})


@pytest.mark.parametrize("kind", SLOW_ONNX)
def test_three_dimensions(tmp_path: Path, dataset_3d: Dataset, kind: Format) -> None:
    geometry = permuted(dataset_3d.geometry)
    run = untrained(tmp_path / "run", dataset_3d, "maximum_likelihood", geometry, activation="silu")
    path = tmp_path / f"model.{kind}"
    export(run, path, format=kind)
    model = load(run)
    forces = some_forces(model, 2)
    fields = model.predict_distribution(forces).fields()
    expected = {name: fields[name] for name in ("displacement", "std")}
    assert_same(run_file(path, forces), expected)


def test_a_file_that_gives_something_else_is_not_left(
    deterministic: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file whose values have a small error is removed."""
    read = surrogate.learning.inference.export.load_exported

    def wrongly(path: Path) -> Callable[..., Any]:
        function = read(path)
        return lambda force: {name: 1.001 * field for name, field in function(force).items()}

    monkeypatch.setattr(surrogate.learning.inference.export, "load_exported", wrongly)
    with pytest.raises(WorkError, match=r"differs from the network by 1\.0e-03, expected 1e-04"):
        export(deterministic, tmp_path / "model.pt2", format="pt2")
    assert list(tmp_path.iterdir()) == []


def test_refusals(
    deterministic: Path, bayes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "model.onnx"
    cases: list[tuple[str, tuple[Path, Path], dict[str, Any]]] = [
        ("expected a file name ending in .onnx", (deterministic, tmp_path / "a.pt2"), {}),
        ("expected a file name ending in .pt2", (deterministic, out), {"format": "pt2"}),
        ("no such folder", (deterministic, tmp_path / "nowhere" / "a.onnx"), {}),
        ("no run there", (tmp_path, out), {}),
        ("passes 3: passes of this network do not", (deterministic, out), {"passes": 3}),
        ("passes = 0, expected 1", (bayes, out), {"passes": 0}),
        ("seed = -1, expected 0", (bayes, out), {"passes": 3, "seed": -1}),
        ("seed 3: expected beside passes", (bayes, out), {"seed": 3}),
    ]
    for message, paths, options in cases:
        with pytest.raises(InputError, match=message):
            export(*paths, **{"format": "onnx", **options})
    monkeypatch.setattr(surrogate.learning.inference.export, "ONNX_LIMIT", 1000)
    with pytest.raises(InputError, match="expected fewer passes, or 'pt2'"):
        export(bayes, out, format="onnx", passes=2)
    monkeypatch.setattr(surrogate.learning.inference.export, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="needs onnx, onnxscript, onnxruntime, expected pip"):
        export(deterministic, out, format="onnx")
    assert list(tmp_path.iterdir()) == []
