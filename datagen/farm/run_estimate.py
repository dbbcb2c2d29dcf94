"""What a run would take: some of its samples are solved and timed, and nothing is written.

All groups of ranks solve at the same time, as in the run, so that the times are those of ranks that
share the machine's memory.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

from datagen.cases.body import make_body
from datagen.cases.case import CaseSource, read_case
from datagen.farm.shard_job import ShardJob
from datagen.farm.work_desk import shard_count
from datagen.output.undeformed_stiffness import stiffness_of
from datagen.ranks import RankGroup
from shared_schema.common.arguments import checked_arguments
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.materials import Volumetric

logger = logging.getLogger(__name__)
SECONDS = 10.0  # of solving, if the samples are fast
MOST = 20  # samples of a group
FEWEST = 2
SHARD_OVERHEAD = 20_000  # bytes of a shard besides its arrays


@dataclass(frozen=True)
class DryRun:
    """Size and duration of a run, from some of its samples.

    Attributes
    ----------
    nodes, cells, dofs : int
        Of the mesh.
    samples, groups : int
        Number of samples of the run, and of groups of ranks that solve them.
    timed, failed : int
        Number of samples that were solved for the estimate, and of those without equilibrium.
    seconds : float
        Mean time of a sample in s.
    bytes : float
        Size of the nodal dataset.
    """

    nodes: int
    cells: int
    dofs: int
    samples: int
    groups: int
    timed: int
    failed: int
    seconds: float
    bytes: float

    @property
    def hours(self) -> float:
        """Time of the whole run in h."""
        return self.seconds * self.samples / self.groups / 3600

    def rows(self) -> Iterator[tuple[str, str]]:
        """Yield names and values for a table."""
        yield "mesh", f"{self.nodes} nodes, {self.cells} cells, {self.dofs} DOFs"
        failed = f", {self.failed} without equilibrium" if self.failed else ""
        yield "a sample", f"{self.seconds:.3g} s, the mean of {self.timed}{failed}"
        duration = f"{self.hours:.3g} h" if self.hours >= 0.1 else f"{3600 * self.hours:.3g} s"
        yield "the run", f"{self.samples} samples, {self.groups} at a time: {duration}"
        yield "the dataset", f"{self.bytes / 1e6:.3g} MB"


@checked_arguments
def dry_run(
    case: CaseSource,
    *,
    samples: int | None = None,
    volumetric: Volumetric | None = None,
    changes: Sequence[str] = (),
    loads: Path | str | None = None,
    trust: bool = False,
    ranks_per_solve: int = 1,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> DryRun:
    """Estimate what a run would take (collective); nothing is written.

    Parameters
    ----------
    case, samples, volumetric, changes, loads, trust
        As for `datagen.cases.case.read_case`.
    ranks_per_solve : int
        Ranks that share each solve.
    comm : mpi4py communicator
        All ranks that would solve.

    Returns
    -------
    DryRun
        On every rank.

    Raises
    ------
    InputError
        On every rank, if the case fits no mesh, its load family draws no load case, or
        `ranks_per_solve` does not divide the number of ranks.
    """
    case = read_case(
        case, volumetric=volumetric, samples=samples, trust=trust, changes=changes, loads=loads
    )
    group = RankGroup.of(comm, ranks_per_solve)
    body = make_body(case, group.comm)
    spread = np.linspace(0, case.dataset.samples - 1, MOST * group.count).round().astype(int)
    numbers = [int(number) for number in dict.fromkeys(spread[group.number :: group.count])]
    job, times = ShardJob(case, body, numbers), []
    while not job.is_complete:
        began = time.perf_counter()
        job.solve_next()
        times.append(time.perf_counter() - began)
        if group.agree(lambda: job.done >= FEWEST and sum(times) > SECONDS):
            break
    arrays, warning = job.arrays(), job.size_warning()
    if comm.rank == 0 and warning is not None:
        logger.warning(warning)
    of_samples = sum(array.nbytes for name, array in arrays.items() if name.startswith("samples/"))
    of_mesh = sum(array.nbytes for array in body.shard_arrays().values())
    counted = times[1:] or times  # the first one allocates and compiles
    found = comm.allgather((counted, job.done, len(job.failed)))
    mesh = body.mesh
    of_stiffness = 0
    if body.problem.kind.corners_only:
        raw = RawMesh(mesh.coordinates, mesh.cells, mesh.cell_type)
        stiffness = stiffness_of(raw, case.material, case.element, body.parts, body.fibres)
        of_stiffness = stiffness.data.nbytes + stiffness.indices.nbytes
    return DryRun(
        nodes=len(mesh.coordinates),
        cells=len(mesh.cells),
        dofs=mesh.coordinates.size,
        samples=case.dataset.samples,
        groups=group.count,
        timed=sum(done for _, done, _ in found),
        failed=sum(failed for _, _, failed in found),
        seconds=float(np.mean([seconds for some, _, _ in found for seconds in some])),
        bytes=of_samples / max(len(job.solved), 1) * case.dataset.samples
        + (of_mesh + SHARD_OVERHEAD) * shard_count(case)
        + of_stiffness,
    )
