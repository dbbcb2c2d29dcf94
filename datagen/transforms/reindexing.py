"""Make a structured dataset from a nodal one: fields on the grid, split, statistics, stiffness."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from datagen.discretisation.element import Element, element_kind
from datagen.transforms.grid_choice import (
    embedded,
    embedded_within,
    log_finer,
    mesh_of,
    require_grid_memory,
    round_trip_errors,
)
from datagen.transforms.written_dataset import (
    RunningStatistics,
    claim_folder,
    locked,
    remove_other_shards,
)
from shared_schema.checker import require_intact
from shared_schema.common.arguments import checked_arguments
from shared_schema.common.bodies.nodal_forces import scatter_forces
from shared_schema.common.bodies.shape_family import TERMS
from shared_schema.common.configuration import validate
from shared_schema.common.errors import InputError
from shared_schema.common.progress import Progress
from shared_schema.common.units import LARGEST_SEED, Units
from shared_schema.dataset_reader import DatasetReader
from shared_schema.grid import Grid, grid_arrays
from shared_schema.layout import Arrays
from shared_schema.manifest import (
    MANIFEST,
    EmbeddingInfo,
    Manifest,
    NodeOrder,
    ShardEntry,
    StructuredInfo,
    read_manifest,
    write_manifest,
)
from shared_schema.materials import materials_of
from shared_schema.samples.dataset_settings import DatasetSettings
from shared_schema.shard import write_shard
from shared_schema.stiffness import Stiffness, read_stiffness, write_stiffness

IMPORT = "import"  # name of a step of before, which made a dataset of PLAID files with its split
KEPT = tuple(
    f"samples/{name}"
    for name in (
        *("stable", "force_between", "parameters"),
        *("actuation", "amplitude", "quantity"),
    )
)
SPLIT_STREAM = 1  # keeps the split's random numbers apart from those of the loads


@checked_arguments
def structure(
    nodal: Path | str,
    out: Path | str,
    *,
    order: NodeOrder = "preferred",
    order_seed: int = 0,
    grid: Sequence[int] | Literal["nodes"] | None = None,
    error: float | None = None,
) -> Manifest:
    """Lay a nodal dataset on the grid of its mesh, or on a grid embedded on the mesh.

    Displacements are rounded to float32; apart from that nodal → structured → nodal is exact. With
    an embedded grid the nodal samples are kept beside those on the grid. The stiffness is that of
    the nodal dataset.

    Parameters
    ----------
    nodal : Path or str
        Nodal dataset.
    out : Path or str
        Folder of the structured dataset: new, or written by this step from the same source.
    order : {"preferred", "gmsh", "random"}
        Order of the nodes on the grid points. Convolutions need the preferred order, in which
        neighbours in space are neighbours on the grid; the others are for the study of it.
    order_seed : int
        Seed of the random order.
    grid : sequence of d ints, or "nodes", optional
        Number of grid points along each axis; it embeds a grid on any mesh, even on one that
        has a structured order. With "nodes" all nodes of the mesh stand in a row, without an
        error: for reduced networks and Gaussian processes, whose modes need no neighbours.
    error : float, optional
        Takes the coarsest embedded grid to which and back displacements differ by no more, relative
        and in the mean over the samples; a grid whose points are the nodes has no error.

    Raises
    ------
    InputError
        If the source is not an intact nodal dataset, order, shape or error do not fit its mesh, or
        the folder holds something else.
    """
    if not 0 <= order_seed <= LARGEST_SEED:
        raise InputError(f"--order-seed {order_seed}: expected a number from 0 to {LARGEST_SEED}")
    source, folder = Path(nodal), Path(out)
    reader = DatasetReader(source, "nodal")
    reader.require_equilibria()
    manifest = reader.manifest
    settings = _settings(manifest, str(source / MANIFEST))
    if manifest.samples < 2:
        raise InputError(f"{source}: {manifest.samples} samples, expected 2 at least")
    shape = grid if grid is None or isinstance(grid, str) else tuple(grid)
    points = _grid_of(reader, shape, error, order, order_seed)
    made = _already_made(folder, manifest, points, order, order_seed)
    if made is not None:
        return made
    with locked(folder):
        made = _already_made(folder, manifest, points, order, order_seed)  # by a run just before
        chosen = error is not None
        return made or _make(reader, folder, points, order, order_seed, settings, chosen)


def _settings(manifest: Manifest, source: str) -> DatasetSettings:
    """Settings of a dataset; InputError if a key is missing or wrong. Nothing is imported."""
    return validate(DatasetSettings, manifest.case.get("dataset"), f"{source}: case.dataset")


def _make(
    reader: DatasetReader,
    folder: Path,
    grid: Grid,
    order: NodeOrder,
    order_seed: int,
    settings: DatasetSettings,
    chosen: bool,
) -> Manifest:
    """Write the structured dataset into its locked folder; the grid is `chosen` by its error."""
    manifest, cell_type = reader.manifest, reader.cell_type
    element: Element = manifest.case.get("element", "linear")
    stiffness: Stiffness | None = None
    claim_folder(folder, manifest.model_copy(update={"kind": "structured"}))
    is_test = split_of(manifest, settings)
    progress = Progress(manifest.samples, 0, "samples", f"datagen structure {manifest.name}")
    force, displacement = RunningStatistics(), RunningStatistics()
    round_trips: list[NDArray[np.float64]] = []
    entries: list[ShardEntry] = []
    start, units = 0, Units.of_case(manifest.case)
    for entry, nodal in reader:
        stop = start + entry.samples
        arrays = structured_arrays(nodal, grid, is_test[start:stop])
        start = stop
        train = ~arrays["samples/is_test"]
        force.add(arrays["samples/force"][train][..., grid.mask])
        displacement.add(arrays["samples/displacement"][train][..., grid.mask])
        round_trips.append(round_trip_errors(grid, nodal["samples/displacement"]))
        path, case_digest = folder / entry.file, manifest.case_digest
        digest = write_shard(path, "structured", arrays, case_digest, cell_type, units)
        entries.append(entry.model_copy(update={"sha256": digest}))
        progress.update(stop)
    progress.close()
    if manifest.stiffness is not None:
        stiffness = read_stiffness(reader.folder)
    elif element_kind(element, cell_type).corners_only and TERMS not in reader.body:
        # written by a version whose `datagen run` did not assemble it
        from datagen.output.undeformed_stiffness import stiffness_of  # of dolfinx

        source = f"{reader.folder / MANIFEST}: case.material"
        stiffness = stiffness_of(
            mesh_of(reader),
            materials_of(manifest.case.get("material"), source),
            element,
            reader.body.get("mesh/material"),
            reader.body.get("mesh/fibres"),
        )
    errors = np.concatenate(round_trips)
    info = StructuredInfo(
        grid_shape=grid.shape,
        order=order,
        order_seed=order_seed,
        train=int((~is_test).sum()),
        test=int(is_test.sum()),
        split_seed=settings.seed,
        force=force.result(),
        displacement=displacement.result(),
        source_digest=manifest.digest,
        embedding=EmbeddingInfo(mean_error=errors.mean(), max_error=errors.max())
        if not grid.points_are_nodes
        else None,
        stiffness=None
        if stiffness is None
        else write_stiffness(folder, stiffness, manifest.case_digest, cell_type, units),
    )
    update: dict[str, Any] = {
        "kind": "structured",
        "shards": tuple(entries),
        "structured": info,
        "stiffness": None,  # it is in `structured`
    }
    if not grid.points_are_nodes and not chosen:
        log_finer(reader, grid)
    remove_other_shards(folder, entries)
    return write_manifest(folder, manifest.model_copy(update=update))


def _already_made(
    folder: Path, source: Manifest, grid: Grid, order: NodeOrder, order_seed: int
) -> Manifest | None:
    """Manifest of an intact dataset that this step wrote earlier from the same source, if any."""
    try:
        made = read_manifest(folder, "structured")
        require_intact(folder, made)
    except InputError:
        return None
    info = made.structured
    assert info is not None
    wanted = (source.digest, order, order_seed, grid.shape, not grid.points_are_nodes)
    found = (info.source_digest, info.order, info.order_seed, info.grid_shape)
    return made if (*found, info.embedding is not None) == wanted else None


def _grid_of(
    reader: DatasetReader,
    shape: tuple[int, ...] | str | None,
    error: float | None,
    order: NodeOrder,
    order_seed: int,
) -> Grid:
    """Grid of the mesh with its nodes in the given order, or an embedded one."""
    if shape is not None and error is not None:
        raise InputError(f"--error {error:g}: expected without --grid, which chooses a grid itself")
    if isinstance(shape, str):
        row = Grid.in_a_row(*reader.body["mesh/coordinates"].shape)
        return in_order(row, order, order_seed)
    if error is not None and not 0 < error < 1:
        raise InputError(f"--error {error:g}: expected a number between 0 and 1, such as 0.01")
    if shape is None:
        try:
            exact = Grid.from_coordinates(reader.body["mesh/coordinates"])
            return in_order(exact, order, order_seed)
        except ValueError as reason:
            if order != "preferred":
                raise InputError(f"--order {order}: {reason}") from None
        if error is not None:
            return embedded_within(reader, error)
    elif order != "preferred":
        raise InputError(f"--order {order}: an embedded grid (--grid) has no other order")
    else:
        _require_sensible(shape, reader)
    return embedded(reader, shape)


def _require_sensible(shape: tuple[int, ...], reader: DatasetReader) -> None:
    """Raise InputError unless an embedded grid fits the dimension and the memory."""
    text, dimension = ",".join(str(count) for count in shape), reader.manifest.dimension
    if len(shape) != dimension or min(shape) < 2:
        raise InputError(f"--grid {text}: expected {dimension} numbers of grid points, at least 2")
    require_grid_memory(shape, reader, f"--grid {text}")


def in_order(grid: Grid, order: NodeOrder, seed: int) -> Grid:
    """Put the nodes on the grid points in the given order."""
    if order == "preferred":
        return grid
    nodes = np.arange(grid.nodes)
    if order == "random":
        nodes = np.random.default_rng(seed).permutation(nodes)
    return grid.reordered(nodes)


def split_of(manifest: Manifest, settings: DatasetSettings) -> NDArray[np.bool_]:
    """Return the test split of a dataset: that which it was imported with, or a random one.

    Raises
    ------
    InputError
        If the imported split is not one of its samples.
    """
    for step in manifest.transforms:
        if step.get("name") == IMPORT:
            rows, numbers = step.get("test"), range(manifest.samples)
            if not isinstance(rows, list) or not all(
                isinstance(row, int) and row in numbers for row in rows
            ):
                raise InputError(f"{manifest.name}: the test split of its import is none of it")
            return np.isin(np.arange(manifest.samples), rows)
    return split(settings, [stage.samples for stage in manifest.history], manifest.samples)


def split(settings: DatasetSettings, stages: Sequence[int], samples: int) -> NDArray[np.bool_]:
    """Choose the test split at random: round(test_fraction · samples) of them, one at least.

    A dataset that has grown is split stage by stage: the samples of a stage stay on their side, and
    those that came later are drawn so that the test split has its part of all samples again.

    Parameters
    ----------
    settings : DatasetSettings
    stages : sequence of int
        Number of solved samples before each growth, ascending.
    samples : int
        Number of solved samples.

    Returns
    -------
    array of bool, (samples,)
        True for samples of the test split, in ascending order of their number.
    """
    is_test = np.zeros(samples, dtype=bool)
    start = 0
    for stop in (*stages, samples):
        test = max(0, min(max(1, round(settings.test_fraction * stop)), stop - 1))
        order = np.random.default_rng([settings.seed, SPLIT_STREAM, stop]).permutation(stop)
        order = order[order >= start]
        is_test[order[: max(0, test - int(is_test[:start].sum()))]] = True
        start = stop
    return is_test


def structured_arrays(nodal: Arrays, grid: Grid, is_test: NDArray[np.bool_]) -> Arrays:
    """Lay the arrays of one nodal shard on the grid: (N, n_nodes, d) → (N, d, nx, ny[, nz])."""
    force, displacement = nodal_forces_of(nodal), nodal["samples/displacement"]
    arrays = {
        **{name: values for name, values in nodal.items() if name.startswith("mesh/")},
        **grid_arrays(grid),
        "samples/number": nodal["samples/number"],
        "samples/is_test": is_test,
        "samples/force": grid.forces_to_grid(force).astype(np.float32),
        "samples/displacement": grid.to_grid(displacement).astype(np.float32),
        **{name: nodal[name] for name in KEPT if name in nodal},
    }
    if not grid.points_are_nodes:
        arrays["samples/loaded_nodes"] = nodal["samples/loaded_nodes"]
        arrays["samples/nodal_force"] = nodal["samples/force"].astype(np.float32)
        arrays["samples/nodal_displacement"] = displacement.astype(np.float32)
    return arrays


def nodal_forces_of(nodal: Arrays) -> NDArray[np.float64]:
    """Force at every node, (N, n_nodes, d) in N, from the loaded nodes of a shard's samples."""
    nodes, loads = nodal["samples/loaded_nodes"], nodal["samples/force"]
    return scatter_forces(nodes, loads, len(nodal["mesh/coordinates"]))
