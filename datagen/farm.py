"""The farm: every load case of a dataset solved, by all ranks, whatever happens on the way.

The samples are cut into shards once and for all. The ranks form groups, each with a mesh of its
own; a group takes the next shard that is not done, solves its samples one after the other, and
its leader writes it. So the dataset does not depend on the number of groups or restarts, and
nothing that is finished is ever done again.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from mpi4py import MPI

from datagen.body import Body, make_body
from datagen.case import Case
from datagen.interruption import Interruption
from datagen.journal import Journal
from datagen.ranks import RankGroup, SharedCounters, on_rank_zero
from datagen.shard_job import ShardJob, shard_count, shard_name, shard_samples
from datagen.software import software_versions
from shared_schema.command_line import Progress
from shared_schema.errors import InputError, StoppedError, WorkError
from shared_schema.manifest import Manifest, ShardEntry, write_manifest
from shared_schema.shard import write_shard

POLL = 0.05  # seconds between two looks at the others' progress, when rank 0 has nothing to do


def run(case: Case, folder: Path, comm: MPI.Comm, ranks_per_solve: int = 1) -> Manifest:
    """Make the nodal dataset of a case in `folder`, going on with what is there (collective).

    Each group of ranks solves on a mesh of its own, and its leader writes its shards; rank 0
    writes the manifest.

    Parameters
    ----------
    case : Case
    folder : Path
    comm : mpi4py communicator
    ranks_per_solve : int
        Ranks of a group, over which its mesh is distributed.

    Returns
    -------
    Manifest
        On every rank.

    Raises
    ------
    InputError
        On every rank, if the folder belongs to another case or run, the case fits no mesh, or
        the ranks make no whole number of groups.
    StoppedError
        On every rank, after SIGINT or SIGTERM to any; what was solved is kept.
    """
    group = RankGroup.of(comm, ranks_per_solve)
    journal = Journal(folder)
    body = None
    if on_rank_zero(comm, lambda: journal.is_new):
        body = _body(case, group)  # wrong input shows here, before anything is written
    on_rank_zero(comm, lambda: journal.open(case))
    done = on_rank_zero(comm, journal.entries)
    todo = [k for k in range(shard_count(case)) if shard_name(k) not in done]
    if todo:
        _make_shards(case, journal, todo, group, body or _body(case, group))
    return on_rank_zero(comm, lambda: _finish(case, journal))


def _make_shards(
    case: Case, journal: Journal, todo: list[int], group: RankGroup, body: Body
) -> None:
    counters = SharedCounters(group.world, "taken", "samples", "failed", "ended", "interrupted")
    total = case.dataset.samples
    before = total - sum(len(shard_samples(case, k)) for k in todo)
    title = f"datagen run {case.name}"
    progress = Progress(total, before, "samples", title, group.world.rank != 0)

    def show() -> None:
        failed = counters.read("failed")
        progress.update(before + counters.read("samples"), f"{failed} failed" if failed else "")

    def count(samples: int, failed: int) -> None:
        if group.is_leader:
            counters.add("samples", samples)
            if failed:
                counters.add("failed", failed)
        if group.world.rank == 0:
            show()

    with Interruption() as interruption:

        def stopped() -> bool:
            if interruption.asked:
                counters.add("interrupted", 1)
            return group.agree(lambda: counters.read("interrupted") > 0)

        while not stopped():
            position = group.agree(lambda: counters.add("taken", 1))
            if position >= len(todo):
                break
            try:
                _make_shard(case, journal, body, todo[position], group, count, stopped)
            except InputError as error:  # on these ranks alone, so that it cannot be the run's
                raise WorkError(f"{shard_name(todo[position])}: {error}") from error
        counters.add("ended", 1)
        if group.world.rank == 0:
            while counters.read("ended") < group.world.size:
                show()
                time.sleep(POLL)
            show()
        progress.close()
        group.world.barrier()
        interrupted = counters.read("interrupted") > 0
        counters.free()
    if interrupted:
        journal.close(complete=False)
        raise StoppedError


def _make_shard(
    case: Case,
    journal: Journal,
    body: Body,
    shard: int,
    group: RankGroup,
    count: Callable[[int, int], None],
    stopped: Callable[[], bool],
) -> None:
    """Solve the samples of a shard and write it, or keep what there is if stopped (per group)."""
    job = ShardJob(case, body, shard)
    part = group.agree(lambda: journal.part(shard_name(shard)))
    if part is not None:
        job.take_up(part)
        count(job.done, len(job.failed))
    while not job.is_complete:
        if stopped():
            if group.is_leader and job.done:
                journal.keep_part(shard_name(shard), job.arrays(), case, body.mesh.cell_type)
            return
        count(1, 0 if job.solve_next() else 1)
    if group.is_leader:
        path = journal.folder / shard_name(shard)
        digest = write_shard(path, "nodal", job.arrays(), case.digest(), body.mesh.cell_type)
        journal.record(
            ShardEntry(
                file=path.name,
                samples=len(job.solved),
                failed=len(job.failed),
                sha256=digest,
            )
        )


def _body(case: Case, group: RankGroup) -> Body:
    """Build the group's own body; the group of rank 0 first, so that only it compiles forms."""
    if group.number == 0:
        body = make_body(case, group.comm)
    group.world.barrier()
    if group.number != 0:
        body = make_body(case, group.comm)
    return body


def _finish(case: Case, journal: Journal) -> Manifest:
    entries = journal.entries()
    shards = tuple(entries[shard_name(k)] for k in range(shard_count(case)))
    manifest = write_manifest(
        journal.folder,
        Manifest(
            kind="nodal",
            name=case.name,
            case=case.plain(),
            case_digest=case.digest(),
            seed=case.dataset.seed,
            software=software_versions(),
            dimension=case.mesh.dimension,
            samples=sum(entry.samples for entry in shards),
            failed=sum(entry.failed for entry in shards),
            shards=shards,
        ),
    )
    journal.close(complete=True)
    return manifest
