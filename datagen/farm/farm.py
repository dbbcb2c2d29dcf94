"""Solve every load case of a dataset on all ranks; resume after any interruption.

The case determines which samples a shard holds. The ranks form groups, each with its own mesh. A
group takes the next piece of work (a shard, near the end a part of one), solves its samples in
turn, and its leader writes them; rank 0 puts the parts together at last. So the dataset does not
depend on the number of groups or restarts, finished work is never repeated, and all groups end
together. A complete dataset can grow: samples that are there are not solved again.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path

from mpi4py import MPI

from datagen.cases.body import Body, make_body
from datagen.cases.case import Case, CaseSource, read_case
from datagen.discretisation.element import element_kind
from datagen.farm.shard_job import ShardJob
from datagen.farm.work_desk import Piece, WorkDesk, plan
from datagen.output.undeformed_stiffness import stiffness_of
from datagen.ranks import RankGroup, on_rank_zero
from datagen.transforms.written_dataset import software_versions
from shared_schema.common.arguments import checked_arguments
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.bodies.reference_cells import CORNERS
from shared_schema.common.bodies.shape_family import TERMS
from shared_schema.common.errors import InputError, StoppedError, WorkError
from shared_schema.common.machine import largest_resident, require_memory
from shared_schema.common.progress import Progress
from shared_schema.loads import act_between
from shared_schema.manifest import Manifest, ShardEntry, SolverRecord, write_manifest
from shared_schema.materials import Volumetric
from shared_schema.samples.journal import Interruption, Journal
from shared_schema.shard import read_arrays, read_attributes, read_shard
from shared_schema.stiffness import write_stiffness

logger = logging.getLogger(__name__)
FIRST = 10  # samples, after which displacements of an unusual size are warned of


class NothingSolvedError(WorkError):
    """No load case of a dataset could be solved; every rank raises it."""


BYTES_PER_SAMPLE = 80  # of the plan of a run, on every rank


@checked_arguments
def run(
    case: CaseSource,
    out: Path | str,
    *,
    samples: int | None = None,
    volumetric: Volumetric | None = None,
    changes: Sequence[str] = (),
    loads: Path | str | None = None,
    trust: bool = False,
    ranks_per_solve: int = 1,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Manifest:
    """Make the nodal dataset of a case, or resume it (collective over the ranks of `comm`).

    In a program of one process it solves one sample after the other; under ``mpirun`` every rank
    calls it. Ranks should not compute in threads besides: set ``OMP_NUM_THREADS=1`` before numpy
    is imported.

    Each group of ranks solves on its own mesh, and its leader writes its shards; rank 0
    assembles and writes the stiffness of the undeformed body, and last the manifest.

    Parameters
    ----------
    case, samples, volumetric, changes, loads, trust
        As for `datagen.cases.case.read_case`; ``samples`` is the number of samples.
    out : Path or str
        Folder of the dataset.
    ranks_per_solve : int
        Ranks of a group, over which its mesh is distributed.
    comm : mpi4py communicator
        All ranks that solve.

    Returns
    -------
    Manifest
        On every rank.

    Raises
    ------
    InputError
        On every rank, if the folder belongs to another case or run, the case fits no mesh, its load
        family draws no load case, or `ranks_per_solve` does not divide the number of ranks.
    NothingSolvedError
        On every rank, if the dataset is complete and no load case has an equilibrium.
    StoppedError
        On every rank, after SIGINT or SIGTERM to any of them; solved samples are kept.
    """
    found = read_case(
        case, volumetric=volumetric, samples=samples, trust=trust, changes=changes, loads=loads
    )
    return _run(found, Path(out), RankGroup.of(comm, ranks_per_solve))


def _run(case: Case, folder: Path, group: RankGroup) -> Manifest:
    """Make or resume the dataset; rank 0 opens and closes the journal."""
    comm, settings = group.world, case.dataset
    said = f"key 'dataset.samples' = {settings.samples}"
    on_rank_zero(comm, lambda: require_memory(BYTES_PER_SAMPLE * settings.samples, said))
    journal = Journal(folder, case, "datagen run")
    body: Body | None = None
    if on_rank_zero(comm, lambda: journal.is_new):
        body = _body(case, group)  # wrong input is found here, before anything is written
        dofs = body.mesh.coordinates.size
        on_rank_zero(comm, lambda: _require_memory(case, dofs))
    on_rank_zero(comm, lambda: journal.open(lambda path: _require_same_loads(case, path)))
    try:
        remaining = on_rank_zero(comm, journal.remaining)
        solver: SolverRecord | None = None
        if remaining:
            body = body or _body(case, group)
            for warning in body.warnings() if comm.rank == 0 else ():
                logger.warning(warning)
            _make_shards(case, journal, remaining, group, body)
            solver = _solver_record(body, comm)
        manifest = on_rank_zero(comm, lambda: _finish(case, journal, solver))
    finally:
        journal.close()
    if manifest.samples == 0:
        raise NothingSolvedError(
            f"{folder}: none of the {manifest.failed} load cases has an equilibrium; "
            "`datagen info` counts the reasons"
        )
    return manifest


def _require_memory(case: Case, dofs: int) -> None:
    """Raise InputError unless a group can keep the displacements of a shard, and write them."""
    samples = min(case.dataset.shard_size, case.dataset.samples)
    what = f"key 'dataset.shard_size': {samples} samples of {dofs} degrees of freedom"
    require_memory(3 * 8.0 * dofs * samples, what)


def _make_shards(
    case: Case, journal: Journal, remaining: dict[int, list[int]], group: RankGroup, body: Body
) -> None:
    pieces = plan(remaining, group.count)
    desk = WorkDesk(group.world, [number * group.comm.size for number in range(group.count)])
    total = case.dataset.samples
    before = total - sum(len(numbers) for numbers in remaining.values())
    title = f"datagen run {case.name}"
    progress = Progress(total, before, "samples", title, group.world.rank != 0)

    def show() -> None:
        progress.update(before + desk.samples, f"{desk.failed} failed" if desk.failed else "")

    def look(step: int, residual: float) -> None:
        desk.look()
        if group.world.rank == 0:
            show()

    body.problem.meanwhile = look

    def count(solved: bool) -> None:
        if group.is_leader:
            desk.count(solved)
        if group.world.rank == 0:
            show()

    wrong: InputError | None = None
    with Interruption() as interruption:

        def stopped() -> bool:
            if interruption.asked:
                desk.stop()
            desk.look()
            return group.agree(lambda: desk.is_stopping)

        while not stopped():
            position = group.agree(desk.take)
            if position >= len(pieces):
                break
            wrong = _make_piece(case, journal, body, pieces[position], group, count, stopped)
            if wrong is not None:  # on the ranks of this group only
                desk.stop()
        desk.close(show)
        if group.world.rank == 0:
            show()
        progress.close()
    found = group.world.allgather(wrong)
    for error in found:
        if error is not None:
            raise error
    if desk.is_stopping:
        raise StoppedError


def _make_piece(
    case: Case,
    journal: Journal,
    body: Body,
    piece: Piece,
    group: RankGroup,
    count: Callable[[bool], None],
    stopped: Callable[[], bool],
) -> InputError | None:
    """Solve a piece and keep its solved samples, even if stopped (collective over the group).

    The result is what is wrong with a load case that the family drew, if anything is.
    """
    job = ShardJob(case, body, piece.numbers, journal.rest, stopped)
    wrong = None
    while not (wrong or job.is_complete or stopped()):
        try:
            count(job.solve_next())
        except StoppedError:
            break
        except InputError as error:
            wrong = error
        is_first = group.is_leader and piece.numbers[0] == 0
        if is_first and (job.done == FIRST or job.is_complete) and (text := job.size_warning()):
            logger.warning(text)
    if group.is_leader:
        _keep(journal, body.mesh.cell_type, piece, job)
    return wrong


def _keep(journal: Journal, cell_type: str, piece: Piece, job: ShardJob) -> None:
    """Write the solved samples of a piece: with those of before as a shard, or as a part of one."""
    if job.is_complete and piece.of == 1 and not journal.extends(piece.shard):
        journal.finish(piece.shard, [*journal.parts(piece.shard), job.arrays()], cell_type)
    elif job.done:
        journal.keep_part(piece.shard, job.arrays(), cell_type)
    job.forget()


def _require_same_loads(case: Case, path: Path) -> None:
    """Raise InputError if distributed loads of a shard or part act on corners of cells alone.

    On elements with points between the nodes, that is so in datasets of earlier versions.
    """
    cell_type, between = str(read_attributes(path, "nodal")["cell_type"]), "samples/force_between"
    if element_kind(case.element, cell_type).corners_only:
        return
    if between in read_arrays(path, "nodal", (between,)):
        return
    if act_between(case.loads, len(CORNERS[cell_type][0])):
        raise InputError(
            f"--out: {path} is made by an earlier version, whose distributed loads act on the "
            "corners of cells alone; expected another folder"
        )


def _body(case: Case, group: RankGroup) -> Body:
    """Build the group's own body; the group of rank 0 first, so that only it compiles forms."""
    if group.number == 0:
        try:
            body = make_body(case, group.comm)
        except InputError:  # the other groups raise it as well
            group.world.barrier()
            raise
    group.world.barrier()
    if group.number != 0:
        body = make_body(case, group.comm)
    return body


def _solver_record(body: Body, comm: MPI.Comm) -> SolverRecord:
    """How the samples were solved (collective)."""
    problem, settings = body.problem, body.case.solver
    return SolverRecord(
        linear_solver=problem.linear_solver,
        unknowns=problem.size,
        memory=comm.allreduce(largest_resident(), op=MPI.MAX),
        stability=settings.stability,
        imperfection=settings.imperfection,
    )


def _finish(case: Case, journal: Journal, solver: SolverRecord | None) -> Manifest:
    """Write what is kept as parts, stiffness and manifest, if they are not there already.

    The journal is removed.
    """
    shards = journal.all_shards()
    manifest = journal.complete_manifest(shards)
    if manifest is None:
        made = _manifest(case, journal, shards).model_copy(update={"solver": solver})
        manifest = write_manifest(journal.folder, made)
    journal.remove()
    return manifest


def _manifest(case: Case, journal: Journal, shards: tuple[ShardEntry, ...]) -> Manifest:
    """Assemble and write the stiffness of the shards' mesh; make the manifest of the dataset."""
    path = journal.folder / shards[0].file
    first, cell_type = read_shard(path, "nodal"), str(read_attributes(path, "nodal")["cell_type"])
    checksum, history = journal.stiffness, journal.history
    dimension = first["mesh/coordinates"].shape[1]
    corners_only = element_kind(case.element, cell_type).corners_only
    is_consistent = not corners_only and (
        "samples/force_between" in first or not act_between(case.loads, dimension)
    )  # else an earlier version has made the shards
    if checksum is None and corners_only and TERMS not in first:  # of one shape
        mesh = RawMesh(first["mesh/coordinates"], first["mesh/cells"], cell_type)
        of_cells = first.get("mesh/material"), first.get("mesh/fibres")
        stiffness = stiffness_of(mesh, case.material, case.element, *of_cells)
        first_digest = history[0].case_digest if history else case.digest()
        folder, units = journal.folder, case.units
        checksum = write_stiffness(folder, stiffness, first_digest, cell_type, units)
    return Manifest(
        kind="nodal",
        name=case.name,
        case=case.plain(),
        case_digest=case.digest(),
        seed=case.dataset.seed,
        units=case.units.labels,
        software=software_versions(),
        dimension=dimension,
        samples=sum(entry.samples for entry in shards),
        failed=sum(entry.failed for entry in shards),
        history=history,
        shards=shards,
        stiffness=checksum,
        forces="consistent" if is_consistent else None,
    )
