"""Small datasets of made-up displacements, and one run that is trained and evaluated on them.

The displacement is a smooth function of the nodal force, not the solution of any equation:
u(x) = s² · 0.4 · tanh(f / 2) · exp(-|x - p|² / 8), with s = x / length the distance from the
clamped end and f the force at the point p.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from shared_schema.grid import Grid
from shared_schema.layout import Arrays
from shared_schema.manifest import (
    ComponentStatistics,
    Manifest,
    ShardEntry,
    StructuredInfo,
    digest_of,
    write_manifest,
)
from shared_schema.shard import write_shard
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.evaluation.run_evaluation import evaluate
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.probabilistic.likelihoods import Likelihood
from surrogate.learning.training.loop import train
from tests.surrogate.unet_configs import unet_config

SAMPLES, TEST = 60, 12
CASES: dict[int, dict[str, Any]] = {
    2: {
        "name": "beam2d",
        "mesh": {"kind": "box", "lower": [0, 0], "upper": [3.5, 1.5], "elements": [7, 3]},
        "material": {"young_modulus": 500.0, "poisson_ratio": 0.4},
        "supports": [{"x": 0}],
        "load": {"family": "random_node", "range": [-2.5, 2.5]},
    },
    3: {
        "name": "block3d",
        "mesh": {"kind": "box", "elements": [7, 3, 3]},
        "material": {"young_modulus": 500.0, "poisson_ratio": 0.4},
        "supports": [{"x": 0}],
        "load": {"family": "random_node", "range": [-2.5, 2.5]},
    },
}
SHAPES = {2: (8, 4), 3: (8, 4, 4)}
CELL_TYPES = {2: "quad", 3: "hexahedron"}
SPACING = 0.5


def box_cells(shape: tuple[int, ...]) -> np.ndarray:
    """Quadrilaterals or hexahedra between the points of a full grid, in VTK order."""
    number = np.arange(int(np.prod(shape))).reshape(shape)
    low, high = slice(None, -1), slice(1, None)
    corners = [(low, low), (high, low), (high, high), (low, high)]
    if len(shape) == 3:
        return np.stack([number[(*c, z)].ravel() for z in (low, high) for c in corners], axis=1)
    return np.stack([number[c].ravel() for c in corners], axis=1)


def make_mesh(dimension: int) -> Arrays:
    coordinates = np.argwhere(np.ones(SHAPES[dimension], dtype=bool)) * SPACING
    return {
        "mesh/coordinates": coordinates,
        "mesh/cells": box_cells(SHAPES[dimension]),
        "mesh/clamped": coordinates[:, 0] == 0,
        "mesh/loadable": (coordinates[:, 0] > 0) & (coordinates[:, 1] == 1.5),
    }


def solve(coordinates: np.ndarray, node: int, force: np.ndarray) -> np.ndarray:
    """The displacement of every node under a force at one; see the top of the file."""
    along = coordinates[:, :1] / coordinates[:, 0].max()
    near = np.exp(-(np.linalg.norm(coordinates - coordinates[node], axis=1) ** 2) / 8)
    displacement: np.ndarray = along**2 * 0.4 * np.tanh(force / 2) * near[:, None]
    return displacement


def statistics(values: np.ndarray) -> ComponentStatistics:
    """Statistics of values (N, d, n_nodes)."""
    axes = (0, 2)
    return ComponentStatistics(
        mean=tuple(values.mean(axis=axes).tolist()),
        std=tuple(values.std(axis=axes).tolist()),
        max_abs=tuple(np.abs(values).max(axis=axes).tolist()),
    )


def build(
    folder: Path,
    dimension: int = 2,
    seed: int = 0,
    corner_forces: np.ndarray | None = None,
    held: np.ndarray | None = None,
    solved: Callable[[Arrays, np.ndarray], np.ndarray] | None = None,
    **case_changes: Any,
) -> Path:
    """Write ``nodal`` and ``structured`` into `folder`; return the structured dataset.

    Sample numbers are dealt to the two shards in turn, so that shards are not in their order.
    With `corner_forces` (60, d), these act at the last loadable node instead of random ones.
    With `held` (n_nodes, d), these components are, and `solved` gives the displacements under
    nodal forces (60, n_nodes, d).
    """
    case = {**CASES[dimension], **case_changes}
    mesh = make_mesh(dimension)
    if held is not None:
        mesh |= {"mesh/held": held, "mesh/clamped": np.asarray(held.all(axis=1))}
    coordinates = mesh["mesh/coordinates"]
    rng = np.random.default_rng(seed)
    nodes = rng.choice(np.flatnonzero(mesh["mesh/loadable"]), SAMPLES)
    forces = rng.uniform(-2.5, 2.5, (SAMPLES, dimension))
    if corner_forces is not None:
        nodes, forces = np.full(SAMPLES, np.flatnonzero(mesh["mesh/loadable"])[-1]), corner_forces
    if held is not None:
        forces = np.where(held[nodes], 0.0, forces)
    displacement = np.stack([solve(coordinates, n, f) for n, f in zip(nodes, forces, strict=True)])
    is_test = np.zeros(SAMPLES, dtype=bool)
    is_test[rng.permutation(SAMPLES)[:TEST]] = True
    grid = Grid.from_coordinates(coordinates)
    nodal_force = np.zeros_like(displacement)
    nodal_force[np.arange(SAMPLES), nodes] = forces
    if solved is not None:
        displacement = solved(mesh, nodal_force)
    force32, displacement32 = nodal_force.astype(np.float32), displacement.astype(np.float32)

    entries: dict[str, list[ShardEntry]] = {"nodal": [], "structured": []}
    for shard in range(2):
        here = np.arange(shard, SAMPLES, 2)
        arrays = {
            "nodal": {
                **mesh,
                "samples/number": here,
                "samples/loaded_nodes": nodes[here, None],
                "samples/force": forces[here, None],
                "samples/displacement": displacement[here],
                "samples/converged_reason": np.full(len(here), 2),
                **{
                    f"samples/{name}": np.ones(len(here), dtype=np.int64)
                    for name in ("load_steps", "cutbacks", "newton_iterations")
                },
                "samples/residual_norm": np.zeros(len(here)),
                "samples/wall_time": np.full(len(here), 0.5),
                "failed/number": np.zeros(0, dtype=np.int64),
                "failed/loaded_nodes": np.zeros((0, 1), dtype=np.int64),
                "failed/force": np.zeros((0, 1, dimension)),
                "failed/load_factor": np.zeros(0),
                "failed/reason": np.zeros(0, dtype=object),
            },
            "structured": {
                **mesh,
                "grid/node_at": grid.node_at,
                "grid/mask": grid.mask,
                "samples/number": here,
                "samples/is_test": is_test[here],
                "samples/force": grid.to_grid(force32[here]),
                "samples/displacement": grid.to_grid(displacement32[here]),
            },
        }
        file = f"shard-{shard:05d}.h5"
        for kind, kind_entries in entries.items():
            (folder / kind).mkdir(parents=True, exist_ok=True)
            digest = write_shard(
                folder / kind / file,
                kind,  # type: ignore[arg-type]
                arrays[kind],
                digest_of(case),
                CELL_TYPES[dimension],
            )
            kind_entries.append(ShardEntry(file=file, samples=len(here), failed=0, sha256=digest))
    manifest = Manifest(
        kind="nodal",
        name=case["name"],
        case=case,
        case_digest=digest_of(case),
        seed=seed,
        software={"dolfinx": "0.5.2", "petsc": "3.18"},
        dimension=dimension,
        samples=SAMPLES,
        failed=0,
        shards=tuple(entries["nodal"]),
    )
    source = write_manifest(folder / "nodal", manifest)
    info = StructuredInfo(
        grid_shape=grid.shape,
        train=SAMPLES - TEST,
        test=TEST,
        split_seed=seed,
        force=statistics(force32[~is_test].swapaxes(1, 2).astype(np.float64)),
        displacement=statistics(displacement32[~is_test].swapaxes(1, 2).astype(np.float64)),
        source_digest=source.digest,
    )
    update = {"kind": "structured", "shards": tuple(entries["structured"]), "structured": info}
    write_manifest(folder / "structured", manifest.model_copy(update=update))
    return folder / "structured"


def small_config(
    optimiser: str = "muon",
    batch_norm: bool = False,
    dimension: int = 2,
    learning_rate: float = 5e-3,
    gradient_clip: float | None = None,
    likelihood: Likelihood = "deterministic",
    variational: dict[str, Any] | None = None,
    **training: Any,
) -> UNetModel:
    """A network that trains in a second; `variational` is for variational Bayes only."""
    content: dict[str, Any] = {
        "name": "small",
        "case": CASES[dimension]["name"],
        "likelihood": likelihood,
        "network": {"levels": 2, "channels": 8, "padding": 1, "batch_norm": batch_norm},
        "training": {
            "epochs": 6,
            "batch_size": 16,
            "optimiser": {
                "name": optimiser,
                "learning_rate": learning_rate,
                "gradient_clip": gradient_clip,
            },
            "schedule": {"name": "linear", "warmup": 0.05},
            "validation_fraction": 0.1,
            **training,
        },
    }
    if likelihood == "variational_bayes":
        content["variational"] = variational or {}
    return unet_config(**content)


@pytest.fixture(autouse=True, scope="session")
def _one_thread() -> None:
    """Sums in an order that does not depend on the machine."""
    torch.set_num_threads(1)


@pytest.fixture(autouse=True)
def _random_numbers_of_the_test() -> None:
    """Each test draws the same numbers, alone and after others."""
    torch.manual_seed(0)


@pytest.fixture(scope="session")
def make_dataset() -> Callable[..., Path]:
    return build


@pytest.fixture(scope="session")
def make_config() -> Callable[..., UNetModel]:
    return small_config


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The structured dataset in two dimensions; not to be changed."""
    return build(tmp_path_factory.mktemp("data2d"))


@pytest.fixture(scope="session")
def data_3d(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("data3d"), 3)


@pytest.fixture(scope="session")
def dataset(data: Path) -> Dataset:
    return read_dataset(data)


@pytest.fixture(scope="session")
def dataset_3d(data_3d: Path) -> Dataset:
    return read_dataset(data_3d)


@pytest.fixture(scope="session")
def make_run(tmp_path_factory: pytest.TempPathFactory, dataset: Dataset) -> Callable[..., Path]:
    """Train on the two-dimensional dataset, with the arguments of `make_config`."""

    def make(**changes: Any) -> Path:
        folder = tmp_path_factory.mktemp("runs") / "run"
        train(small_config(**changes), dataset, folder, device="cpu")
        return folder

    return make


@pytest.fixture(scope="session")
def trained(make_run: Callable[..., Path]) -> Path:
    """A trained run; not to be changed."""
    return make_run(epochs=40)


@pytest.fixture(scope="session")
def trained_bayes(make_run: Callable[..., Path]) -> Path:
    """A run with random weights, after an epoch; not to be changed."""
    return make_run(epochs=1, likelihood="variational_bayes")


@pytest.fixture(scope="session")
def evaluated(make_run: Callable[..., Path], data: Path) -> Path:
    """A trained and evaluated run; not to be changed."""
    folder = make_run(epochs=40)
    evaluate(folder, data).write()
    return folder
