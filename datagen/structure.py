"""From a nodal dataset to a structured one: nodal vectors laid on the grid, split, statistics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.case import Case
from datagen.new_folder import require_free
from shared_schema.checker import require_intact
from shared_schema.command_line import Progress
from shared_schema.configuration import validate
from shared_schema.errors import InputError
from shared_schema.grid_map import GridMap
from shared_schema.manifest import (
    MANIFEST,
    ComponentStatistics,
    Manifest,
    NodeOrder,
    ShardEntry,
    StructuredInfo,
    read_manifest,
    write_manifest,
)
from shared_schema.shard import Arrays, read_attributes, read_shard, write_shard

SPLIT_STREAM = 1  # keeps the split's random numbers apart from those of the loads


def structure(
    source: Path, folder: Path, order: NodeOrder = "preferred", order_seed: int = 0
) -> Manifest:
    """Lay a nodal dataset on its grid.

    Displacements are rounded to float32; apart from that nodal → structured → nodal is exact.

    Parameters
    ----------
    source : Path
        Nodal dataset.
    folder : Path
        Where the structured one shall be; made new, or made again from the same source.
    order : {"preferred", "gmsh", "random"}
        Which node stands at a grid point. Convolutions need the preferred order, in which
        neighbours in space are neighbours on the grid; the others are for the study of that.
    order_seed : int
        Of the random order.

    Raises
    ------
    InputError
        If the source is no intact nodal dataset, its mesh has no structured order, or the folder
        holds something else.
    """
    manifest = read_manifest(source, "nodal")
    case = validate(Case, manifest.case, str(source / MANIFEST))
    require_intact(source, manifest)
    if manifest.samples < 2:
        raise InputError(f"{source}: {manifest.samples} samples, expected 2 at least")
    made = _already_made(folder, manifest, order, order_seed)
    if made is not None:
        return made
    first = read_shard(source / manifest.shards[0].file, "nodal")
    grid = in_order(_grid_of(first, source), order, order_seed)
    require_free(folder, manifest.model_copy(update={"kind": "structured"}))
    is_test = split(case, manifest.samples)
    progress = Progress(manifest.samples, 0, "samples", f"datagen structure {case.name}")
    force, displacement = RunningStatistics(), RunningStatistics()
    entries: list[ShardEntry] = []
    start = 0
    folder.mkdir(parents=True, exist_ok=True)
    for entry in manifest.shards:
        nodal = read_shard(source / entry.file, "nodal")
        stop = start + entry.samples
        arrays = structured_arrays(nodal, grid, is_test[start:stop])
        start = stop
        train = ~arrays["samples/is_test"]
        force.add(arrays["samples/force"][train][..., grid.mask])
        displacement.add(arrays["samples/displacement"][train][..., grid.mask])
        attributes = read_attributes(source / entry.file, "nodal")
        digest = write_shard(
            folder / entry.file,
            "structured",
            arrays,
            manifest.case_digest,
            str(attributes["cell_type"]),
        )
        entries.append(ShardEntry(file=entry.file, samples=entry.samples, failed=0, sha256=digest))
        progress.update(stop)
    progress.close()
    info = StructuredInfo(
        grid_shape=grid.shape,
        order=order,
        order_seed=order_seed,
        train=int((~is_test).sum()),
        test=int(is_test.sum()),
        split_seed=case.dataset.seed,
        force=force.result(),
        displacement=displacement.result(),
        source_digest=manifest.digest,
    )
    update: dict[str, Any] = {
        "kind": "structured",
        "failed": 0,
        "shards": tuple(entries),
        "structured": info,
    }
    return write_manifest(folder, manifest.model_copy(update=update))


def _already_made(
    folder: Path, source: Manifest, order: NodeOrder, order_seed: int
) -> Manifest | None:
    """The manifest of an intact dataset that this step made before from the same source."""
    try:
        made = read_manifest(folder, "structured")
        require_intact(folder, made)
    except InputError:
        return None
    info = made.structured
    assert info is not None
    wanted = (source.digest, order, order_seed)
    return made if (info.source_digest, info.order, info.order_seed) == wanted else None


def _grid_of(nodal: Arrays, source: Path) -> GridMap:
    try:
        return GridMap.from_coordinates(nodal["mesh/coordinates"])
    except ValueError as error:
        raise InputError(f"{source}: {error}") from None


def in_order(grid: GridMap, order: NodeOrder, seed: int) -> GridMap:
    """Put the nodes on the grid points in the order asked for."""
    if order == "preferred":
        return grid
    nodes = np.arange(grid.nodes)
    if order == "random":
        nodes = np.random.default_rng(seed).permutation(nodes)
    return grid.reordered(nodes)


def split(case: Case, samples: int) -> NDArray[np.bool_]:
    """Choose the test split at random: round(test_fraction · samples) of them, one at least."""
    test = min(max(1, round(case.dataset.test_fraction * samples)), samples - 1)
    order = np.random.default_rng([case.dataset.seed, SPLIT_STREAM, samples]).permutation(samples)
    is_test = np.zeros(samples, dtype=bool)
    is_test[order[:test]] = True
    return is_test


def structured_arrays(nodal: Arrays, grid: GridMap, is_test: NDArray[np.bool_]) -> Arrays:
    """Lay the arrays of one nodal shard on the grid: (N, n_nodes, d) → (N, d, nx, ny[, nz])."""
    force = nodal_forces_of(nodal)
    return {
        **{name: values for name, values in nodal.items() if name.startswith("mesh/")},
        "grid/node_at": grid.node_at,
        "grid/mask": grid.mask,
        "samples/number": nodal["samples/number"],
        "samples/is_test": is_test,
        "samples/force": grid.to_grid(force.astype(np.float32)),
        "samples/displacement": grid.to_grid(nodal["samples/displacement"].astype(np.float32)),
    }


def nodal_forces_of(nodal: Arrays) -> NDArray[np.float64]:
    """Force at every node, (N, n_nodes, d) in N, from the loaded nodes of a shard's samples."""
    force = np.zeros_like(nodal["samples/displacement"])
    sample, load = np.nonzero(nodal["samples/loaded_nodes"] >= 0)
    nodes = nodal["samples/loaded_nodes"][sample, load]
    force[sample, nodes] = nodal["samples/force"][sample, load]
    return force


class RunningStatistics:
    """Mean, standard deviation and largest magnitude of each component, shard by shard."""

    def __init__(self) -> None:
        self._count = 0
        self._sum: Any = 0.0
        self._squares: Any = 0.0
        self._max: Any = 0.0

    def add(self, values: NDArray[np.float32]) -> None:
        """Take in values of shape (N, d, n_nodes)."""
        if values.size == 0:
            return
        exact = values.astype(np.float64)
        self._count += exact.shape[0] * exact.shape[2]
        self._sum = self._sum + exact.sum(axis=(0, 2))
        self._squares = self._squares + (exact**2).sum(axis=(0, 2))
        self._max = np.maximum(self._max, np.abs(exact).max(axis=(0, 2)))

    def result(self) -> ComponentStatistics:
        """Statistics of everything taken in."""
        mean = self._sum / self._count
        std = np.sqrt(np.maximum(self._squares / self._count - mean**2, 0.0))
        return ComponentStatistics(
            mean=tuple(mean.tolist()), std=tuple(std.tolist()), max_abs=tuple(self._max.tolist())
        )
