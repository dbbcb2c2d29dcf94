"""The farm: every load case of a dataset solved, by all ranks, whatever happens on the way.

The samples are cut into shards once and for all; a rank takes the next shard that is not done,
solves its samples one after the other, and writes it. So the dataset does not depend on the
number of ranks or restarts, and nothing that is finished is ever done again.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from datagen.body import Body, make_body
from datagen.case import Case
from datagen.journal import Journal
from datagen.load_stepping import SolveReport, solve_load_case
from datagen.loads import LoadCase
from datagen.ranks import SharedCounters, on_rank_zero
from datagen.software import software_versions
from shared_schema.command_line import Progress
from shared_schema.errors import InputError, WorkError
from shared_schema.manifest import Manifest, ShardEntry, write_manifest
from shared_schema.shard import write_shard

NO_NODE = -1
POLL = 0.05  # seconds between two looks at the others' progress, when rank 0 has nothing to do


def run(case: Case, folder: Path, comm: MPI.Comm) -> Manifest:
    """Make the nodal dataset of a case in `folder`, going on with what is there (collective).

    Each rank solves on a mesh of its own and writes its own shards; rank 0 writes the manifest.

    Returns
    -------
    Manifest
        On every rank.

    Raises
    ------
    InputError
        On every rank, if the folder belongs to another case or run, or the case fits no mesh.
    """
    journal = Journal(folder)
    on_rank_zero(comm, lambda: journal.open(case))
    done = on_rank_zero(comm, journal.entries)
    todo = [k for k in range(shard_count(case)) if shard_name(k) not in done]
    if todo:
        _make_shards(case, journal, todo, comm)
    return on_rank_zero(comm, lambda: _finish(case, journal))


def _make_shards(case: Case, journal: Journal, todo: list[int], comm: MPI.Comm) -> None:
    body = _bodies(case, comm)
    counters = SharedCounters(comm, "taken", "samples", "shards", "failed")
    total = case.dataset.samples
    before = total - sum(len(shard_samples(case, k)) for k in todo)
    progress = Progress(total, before, "samples", f"datagen run {case.name}", comm.rank != 0)

    def show() -> None:
        failed = counters.read("failed")
        progress.update(before + counters.read("samples"), f"{failed} failed" if failed else "")

    def after_sample(failed: bool) -> None:
        counters.add("samples", 1)
        if failed:
            counters.add("failed", 1)
        if comm.rank == 0:
            show()

    while (position := counters.add("taken", 1)) < len(todo):
        shard = todo[position]
        try:
            arrays = solve_shard(case, body, shard, after_sample)
        except InputError as error:  # on this rank alone, so that it cannot be the run's
            raise WorkError(f"{shard_name(shard)}: {error}") from error
        digest = write_shard(
            journal.folder / shard_name(shard), "nodal", arrays, case.digest(), body.mesh.cell_type
        )
        journal.record(
            ShardEntry(
                file=shard_name(shard),
                samples=len(arrays["samples/number"]),
                failed=len(arrays["failed/number"]),
                sha256=digest,
            )
        )
        counters.add("shards", 1)
    if comm.rank == 0:
        while counters.read("shards") < len(todo):
            show()
            time.sleep(POLL)
        show()
    progress.close()
    comm.barrier()
    counters.free()


def _bodies(case: Case, comm: MPI.Comm) -> Body:
    """Build this rank's own body; rank 0 first, so that only it compiles the forms."""
    if comm.rank == 0:
        body = make_body(case, MPI.COMM_SELF)
    comm.barrier()
    if comm.rank != 0:
        body = make_body(case, MPI.COMM_SELF)
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


def shard_count(case: Case) -> int:
    """Number of shards of the dataset."""
    return -(-case.dataset.samples // case.dataset.shard_size)


def shard_name(shard: int) -> str:
    """File name of a shard."""
    return f"shard-{shard:05d}.h5"


def shard_samples(case: Case, shard: int) -> range:
    """Sample numbers of a shard."""
    size = case.dataset.shard_size
    return range(shard * size, min((shard + 1) * size, case.dataset.samples))


def solve_shard(
    case: Case, body: Body, shard: int, after_sample: Callable[[bool], None]
) -> dict[str, Any]:
    """Solve every load case of a shard.

    Parameters
    ----------
    case : Case
    body : Body
        This rank's own.
    shard : int
    after_sample : callable
        Told after each load case whether it failed.

    Returns
    -------
    dict of str to array
        The shard's arrays, by the schema's paths.
    """
    loadable = body.loadable_nodes
    solved: list[tuple[int, LoadCase, SolveReport, Any, float]] = []
    failed: list[tuple[int, LoadCase, SolveReport]] = []
    for number in shard_samples(case, shard):
        load = case.load.draw(number, case.dataset.seed, loadable)
        began = time.perf_counter()
        report = solve_load_case(body.problem, load.nodes, load.forces, case.solver)
        elapsed = time.perf_counter() - began
        if report.solved:
            solved.append((number, load, report, body.problem.displacement(), elapsed))
        else:
            failed.append((number, load, report))
        after_sample(not report.solved)

    width = case.load.loads_per_sample(loadable)
    dimension = case.mesh.dimension
    reports = [sample[2] for sample in solved]

    def integers(name: str) -> Any:
        return np.array([getattr(report, name) for report in reports], dtype=np.int64)

    loaded_nodes, force = _pad([sample[1] for sample in solved], width, dimension)
    failed_nodes, failed_force = _pad([sample[1] for sample in failed], width, dimension)
    displacement = np.array([sample[3] for sample in solved], dtype=np.float64)
    return {
        **body.shard_arrays(),
        "samples/number": np.array([sample[0] for sample in solved], dtype=np.int64),
        "samples/loaded_nodes": loaded_nodes,
        "samples/force": force,
        "samples/displacement": displacement.reshape(-1, len(body.clamped), dimension),
        "samples/converged_reason": integers("reason"),
        "samples/load_steps": integers("load_steps"),
        "samples/cutbacks": integers("cutbacks"),
        "samples/newton_iterations": integers("newton_iterations"),
        "samples/residual_norm": np.array([r.residual_norm for r in reports], dtype=np.float64),
        "samples/wall_time": np.array([sample[4] for sample in solved], dtype=np.float64),
        "failed/number": np.array([sample[0] for sample in failed], dtype=np.int64),
        "failed/loaded_nodes": failed_nodes,
        "failed/force": failed_force,
        "failed/load_factor": np.array([s[2].load_factor for s in failed], dtype=np.float64),
        "failed/reason": np.array([s[2].explanation for s in failed], dtype=object),
    }


def _pad(loads: list[LoadCase], width: int, dimension: int) -> tuple[Any, Any]:
    nodes = np.full((len(loads), width), NO_NODE, dtype=np.int64)
    force = np.zeros((len(loads), width, dimension))
    for row, load in enumerate(loads):
        nodes[row, : len(load.nodes)] = load.nodes
        force[row, : len(load.nodes)] = load.forces
    return nodes, force
