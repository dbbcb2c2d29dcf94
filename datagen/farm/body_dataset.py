"""The dataset of a body alone: mesh, supports, materials and loadable nodes, and no samples.

Nothing is solved, so no equation is set up. A surrogate that follows from the mesh and the material
(`model: series`) needs no more.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from datagen.cases.case import Case, CaseSource, read_case
from datagen.cases.placed_body import PlacedBody, placed
from datagen.transforms.written_dataset import (
    RunningStatistics,
    claim_folder,
    locked,
    remove_other_shards,
    software_versions,
)
from shared_schema.common.arguments import checked_arguments
from shared_schema.common.bodies.cells import conformity_problem
from shared_schema.common.bodies.nodal_forces import scatter_forces
from shared_schema.common.errors import InputError
from shared_schema.grid import Grid, grid_arrays
from shared_schema.manifest import (
    MANIFEST,
    ComponentStatistics,
    Manifest,
    ShardEntry,
    StructuredInfo,
    read_manifest,
    write_manifest,
)
from shared_schema.materials import Volumetric
from shared_schema.shard import write_shard

logger = logging.getLogger(__name__)
DRAWN = 100  # load cases, whose forces are those of the manifest's statistics
SHARD = "shard-00000.h5"


@checked_arguments
def body(
    case: CaseSource,
    out: Path | str,
    *,
    volumetric: Volumetric | None = None,
    changes: Sequence[str] = (),
    trust: bool = False,
) -> Manifest:
    """Make the structured dataset of a case's body, which has no samples.

    Its statistics of forces are those of the first load cases that the case's family draws. Its
    grid is that of the mesh; the nodes of a mesh without a structured order stand in a row.

    Parameters
    ----------
    case, volumetric, changes, trust
        As for `datagen.cases.case.read_case`.
    out : Path or str
        Folder of the dataset: new, or written by this step from the same case.

    Raises
    ------
    InputError
        If the case fits no mesh, its load family draws no force, or the folder holds something
        else.
    """
    found = read_case(case, volumetric=volumetric, trust=trust, changes=changes)
    folder = Path(out)
    _require_bodies_only(folder)
    on_mesh = _on_mesh(found)
    for warning in on_mesh.warnings():
        logger.warning(warning)
    force = _forces_drawn(on_mesh)
    with locked(folder):
        _require_bodies_only(folder)
        return _write(on_mesh, force, folder)


def _require_bodies_only(folder: Path) -> None:
    """Raise InputError if a folder holds a dataset with samples."""
    if (folder / MANIFEST).is_file() and (count := read_manifest(folder).samples):
        raise InputError(f"--out '{folder}': holds a dataset of {count} samples")


def _on_mesh(case: Case) -> PlacedBody:
    """Mesh the geometry of a case, on this process alone."""
    try:
        mesh = case.mesh.raw_mesh()
        problem = conformity_problem(mesh.coordinates, mesh.cells, mesh.cell_type)
        if problem is not None:
            raise InputError(f"mesh: {problem}")
    except InputError as error:
        raise InputError(f"case '{case.name}': {error}") from None
    return placed(case, mesh)


def _forces_drawn(body: PlacedBody) -> ComponentStatistics:
    """Statistics of the forces of the first load cases; InputError if there are none."""
    nothing = np.zeros(body.loads.positions.shape)
    statistics = RunningStatistics()
    for number in range(min(DRAWN, body.case.dataset.samples)):
        load = body.loads[number]
        given = [c.value if c.gives_amplitude else 0.0 for c in load.actuation]
        nodes, forces, _ = body.loads.recorded(load, nothing, amplitudes=np.array(given))
        force = scatter_forces(nodes, forces, len(body.held))
        statistics.add(force.T[None].astype(np.float32))
    found = statistics.result()
    if not any(found.max_abs):
        raise InputError(
            f"case '{body.case.name}': key 'load': no load case has a force, expected some"
        )
    return found


def grid_of_mesh(coordinates: NDArray[np.float64]) -> Grid:
    """Grid of the mesh if it has a structured order, else all nodes in a row along x."""
    try:
        return Grid.from_coordinates(coordinates)
    except ValueError:
        return Grid.in_a_row(*coordinates.shape)


def _write(body: PlacedBody, force: ComponentStatistics, folder: Path) -> Manifest:
    """Write shard and manifest into the locked folder."""
    case, mesh = body.case, body.mesh
    dimension = mesh.coordinates.shape[1]
    grid = grid_of_mesh(mesh.coordinates)
    no_field = np.zeros((0, dimension, *grid.shape), np.float32)
    nothing = (0.0,) * dimension
    manifest = Manifest(
        kind="structured",
        name=case.name,
        case=case.plain(),
        case_digest=case.digest(),
        seed=case.dataset.seed,
        units=case.units.labels,
        software=software_versions(solved=False),
        dimension=dimension,
        samples=0,
        failed=0,
        forces=body.forces,
        shards=(),
        structured=StructuredInfo(
            grid_shape=grid.shape,
            train=0,
            test=0,
            split_seed=case.dataset.seed,
            force=force,
            displacement=ComponentStatistics(mean=nothing, std=nothing, max_abs=nothing),
            source_digest=case.digest(),
        ),
    )
    claim_folder(folder, manifest)
    arrays = {
        **body.shard_arrays(),
        **grid_arrays(grid),
        "samples/number": np.zeros(0, np.int64),
        "samples/is_test": np.zeros(0, np.bool_),
        "samples/force": no_field,
        "samples/displacement": no_field,
    }
    digest = write_shard(
        folder / SHARD, "structured", arrays, case.digest(), mesh.cell_type, case.units
    )
    entry = ShardEntry(file=SHARD, samples=0, failed=0, sha256=digest)
    remove_other_shards(folder, [entry])
    return write_manifest(folder, manifest.model_copy(update={"shards": (entry,)}))
