"""Bodies that are held in single components: by symmetry planes, and by rollers.

The plate is the quarter of one that is pulled: x = 0 is held along x, y = 0 along y, so that a
single node does not move at all. The block stands on z = 0 and leans against x = 0, and one edge is
held along y. The displacements are equilibria of the learner's finite elements.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from shared_schema.checker import check_dataset
from shared_schema.grid import Grid, grid_arrays
from shared_schema.layout import Arrays
from shared_schema.manifest import EmbeddingInfo, read_manifest, write_manifest
from shared_schema.materials import NeoHookean
from shared_schema.shard import read_shard, write_shard
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from tests.surrogate.conftest import CELL_TYPES, SHAPES, build, make_mesh

MATERIAL = NeoHookean(young_modulus=500.0, poisson_ratio=0.4)
SUPPORTS = {
    2: [{"x": 0, "components": ["x"]}, {"y": 0, "components": ["y"]}],
    3: [
        {"x": 0, "components": ["x"]},
        {"z": 0, "components": ["z"]},
        {"x": 0, "y": 0, "components": ["y"]},
    ],
}


def held_components(dimension: int) -> np.ndarray:
    """Components that are held, (n_nodes, d)."""
    x = make_mesh(dimension)["mesh/coordinates"]
    held = x == 0
    if dimension == 3:
        held[:, 1] &= x[:, 0] == 0
    return held


def equilibria(mesh: Arrays, force: np.ndarray) -> np.ndarray:
    """Displacements of the Neo-Hookean body in m, (N, n_nodes, d)."""
    d = mesh["mesh/coordinates"].shape[1]
    grid = Grid.from_coordinates(mesh["mesh/coordinates"])
    geometry = Geometry.from_arrays({**mesh, **grid_arrays(grid)}, CELL_TYPES[d])
    body = Equilibrium(geometry, MATERIAL)
    return np.stack([correct(body, f, np.zeros_like(f)).displacement for f in force])


def rolling(folder: Path, dimension: int, embedded: bool = False) -> Path:
    """Write the dataset of a body; return the structured one, on its nodes or embedded."""
    held = held_components(dimension)
    data = build(folder, dimension, held=held, solved=equilibria, supports=SUPPORTS[dimension])
    return on_embedded_grid(data, folder / "embedded", dimension) if embedded else data


def hats(at: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Values of the piecewise linear functions of some knots, (n_at, n_knots)."""
    return np.stack([np.interp(at, knots, unit) for unit in np.eye(len(knots))], axis=1)


def multilinear_grid(coordinates: np.ndarray, shape: tuple[int, ...]) -> Grid:
    """Embed a grid on the nodes of a box, in their order, both with all weights written out."""
    to_nodes, to_grid = np.ones((1, 1)), np.ones((1, 1))
    for axis, count in enumerate(shape):
        lines = np.unique(coordinates[:, axis])
        points = np.linspace(0, lines.max(), count)
        to_nodes, to_grid = (
            np.kron(to_nodes, hats(lines, points)),
            np.kron(to_grid, hats(points, lines)),
        )
    points = np.broadcast_to(np.arange(to_nodes.shape[1]), to_nodes.shape)
    sources = np.broadcast_to(np.arange(to_grid.shape[1]), to_grid.shape)
    return Grid(sources.reshape(*shape, -1), to_grid.reshape(*shape, -1), points, to_nodes)


def on_embedded_grid(data: Path, folder: Path, dimension: int) -> Path:
    """Copy a structured dataset to a grid with a point less along every axis."""
    folder.mkdir()
    manifest = read_manifest(data, "structured")
    coordinates = make_mesh(dimension)["mesh/coordinates"]
    other = multilinear_grid(coordinates, tuple(count - 1 for count in SHAPES[dimension]))
    entries = []
    for entry in manifest.shards:
        arrays = read_shard(data / entry.file, "structured")
        grid = Grid.of_nodes(arrays.pop("grid/node_at"))
        force, displacement = (
            grid.to_nodes(arrays[f"samples/{name}"]) for name in ("force", "displacement")
        )
        loaded = np.abs(force).sum(axis=2).argmax(axis=1)
        arrays |= grid_arrays(other)
        arrays["samples/force"] = other.forces_to_grid(force)
        arrays["samples/displacement"] = other.to_grid(displacement)
        arrays["samples/loaded_nodes"] = loaded[:, None]
        arrays["samples/nodal_force"] = force[np.arange(len(loaded)), loaded][:, None]
        arrays["samples/nodal_displacement"] = displacement
        kind = CELL_TYPES[dimension]
        digest = write_shard(folder / entry.file, "structured", arrays, manifest.case_digest, kind)
        entries.append(entry.model_copy(update={"sha256": digest}))
    assert manifest.structured is not None
    embedding = EmbeddingInfo(mean_error=0.0, max_error=0.0)
    update = {"embedding": embedding, "grid_shape": other.shape}
    structured = manifest.structured.model_copy(update=update)
    write_manifest(
        folder, manifest.model_copy(update={"shards": tuple(entries), "structured": structured})
    )
    assert check_dataset(folder) == []
    return folder
