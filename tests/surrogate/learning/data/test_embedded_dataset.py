"""Datasets on an embedded grid; an embedding that is the identity changes nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shared_schema.checker import check_dataset
from shared_schema.grid import Grid, grid_arrays
from shared_schema.manifest import EmbeddingInfo, read_manifest, write_manifest
from shared_schema.shard import read_shard, write_shard
from surrogate.learning.data.body_check import differing_array
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.evaluation.run_evaluation import evaluate
from surrogate.learning.evaluation.run_report import write_report
from surrogate.learning.inference.loading import load
from surrogate.learning.models.model import Model
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.training.loop import train

BETWEEN = 13  # the node that is the mean of two points in the embedding that is not the identity


def identity(grid: Grid) -> Grid:
    """Return an embedded grid that maps every node to its own grid point, and back."""
    points = np.empty((grid.nodes, 1), dtype=np.int64)
    points[grid.node_at.ravel(), 0] = np.arange(grid.nodes)
    sources = np.stack((grid.node_at, grid.node_at), axis=-1)
    weights = np.broadcast_to([1.0, 0.0], sources.shape)  # the second source has no effect
    return Grid(sources, weights, points, np.ones((grid.nodes, 1)))


def averaging(grid: Grid) -> Grid:
    """Return `identity`, except that one node is the mean of its grid point and the next one."""
    same = identity(grid)
    points = np.concatenate((same.points, same.points), axis=1)
    weights = np.tile([1.0, 0.0], (grid.nodes, 1))
    points[BETWEEN, 1] += 1
    weights[BETWEEN] = 0.5
    return Grid(same.sources, same.source_weights, points, weights)


def embedded(data: Path, folder: Path, embedding: Callable[[Grid], Grid] = identity) -> Path:
    """Copy a structured dataset to an embedded grid."""
    folder.mkdir()
    manifest = read_manifest(data, "structured")
    cell_type = {2: "quad", 3: "hexahedron"}[manifest.dimension]
    entries = []
    for entry in manifest.shards:
        arrays = read_shard(data / entry.file, "structured")
        grid = Grid.of_nodes(arrays.pop("grid/node_at"))
        force, displacement = (
            grid.to_nodes(arrays[f"samples/{name}"]) for name in ("force", "displacement")
        )
        loaded = np.abs(force).sum(axis=2).argmax(axis=1)
        other = embedding(grid)
        arrays |= grid_arrays(other)
        if other.shape != grid.shape:
            arrays["samples/force"] = other.forces_to_grid(force)
            arrays["samples/displacement"] = other.to_grid(displacement)
        arrays["samples/loaded_nodes"] = loaded[:, None]
        arrays["samples/nodal_force"] = force[np.arange(len(loaded)), loaded][:, None]
        arrays["samples/nodal_displacement"] = displacement
        digest = write_shard(
            folder / entry.file, "structured", arrays, manifest.case_digest, cell_type
        )
        entries.append(entry.model_copy(update={"sha256": digest}))
    assert manifest.structured is not None
    info = manifest.structured.model_copy(
        update={
            "embedding": EmbeddingInfo(mean_error=0.0, max_error=0.0),
            "grid_shape": other.shape,
        }
    )
    update = {"shards": tuple(entries), "structured": info}
    write_manifest(folder, manifest.model_copy(update=update))
    assert check_dataset(folder) == []
    return folder


def trained_on(data: Path, run: Path, config: Model) -> dict[str, Any]:
    train(config, read_dataset(data), run, device="cpu")
    return evaluate(run, data).content


def test_nodal_samples_of_both_kinds(data: Path, tmp_path: Path) -> None:
    one, other = read_dataset(data), read_dataset(embedded(data, tmp_path / "data"))
    assert np.array_equal(one.nodal_test.force, other.nodal_test.force)
    assert np.array_equal(one.nodal_test.displacement, other.nodal_test.displacement)
    assert np.array_equal(one.geometry.free_mask, other.geometry.free_mask)
    assert differing_array(one.geometry.arrays(), other.geometry.arrays()) is not None


def test_the_identity_changes_nothing(
    data: Path, tmp_path: Path, make_config: Callable[..., UNetModel]
) -> None:
    """Network, predictions and measures are the same, bit for bit."""
    config = make_config(epochs=3)
    one = trained_on(data, tmp_path / "one", config)
    other = trained_on(embedded(data, tmp_path / "data"), tmp_path / "other", config)
    assert one["test"] == other["test"]
    assert other["embedding_error"] == 0.0
    assert "embedding_error" not in one
    forces = read_dataset(data).nodal_test.force
    predicted = [load(tmp_path / run).predict(forces) for run in ("one", "other")]
    assert np.array_equal(predicted[0], predicted[1])


def test_the_error_of_the_embedding_itself(
    data: Path, tmp_path: Path, make_config: Callable[..., UNetModel]
) -> None:
    """One node of 32 has the error |u_next − u| / 2; ē is the mean over all components."""
    folder = embedded(data, tmp_path / "data", averaging)
    content = trained_on(folder, tmp_path / "run", make_config(epochs=1))
    u = read_dataset(data).nodal_test.displacement
    nodes = Grid.from_coordinates(load(tmp_path / "run").geometry.coordinates).node_at.ravel()
    after = nodes[np.flatnonzero(nodes == BETWEEN)[0] + 1]
    expected = np.abs(u[:, after] - u[:, BETWEEN]).mean() / 2 / 32
    assert content["embedding_error"] == pytest.approx(expected, rel=1e-5)
    evaluation = evaluate(tmp_path / "run", folder)
    assert f"of the embedded grid it would be {expected:.3e} m" in str(evaluation)
    evaluation.write()
    write_report(tmp_path / "run", tmp_path / "report.html")
    row = f"without an error at its points [10⁻³ m]</td><td>{expected * 1e3:.3f}"
    page = (tmp_path / "report.html").read_text()
    assert row in page.replace("\n", "").replace("> ", ">")


def test_a_run_on_another_grid_is_refused(
    data: Path, tmp_path: Path, make_config: Callable[..., UNetModel]
) -> None:
    trained_on(data, tmp_path / "run", make_config(epochs=1))
    with pytest.raises(Exception, match="the mesh is not that of the dataset"):
        evaluate(tmp_path / "run", embedded(data, tmp_path / "data"))
