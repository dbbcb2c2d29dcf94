"""Make the nodal dataset of a body, as `datagen run` does; killed and resumed at any time.

Workers are processes of their own, each with the body, that solve some samples at a time. This
process writes the shards, with the journal that `datagen run` has (`shared_schema.samples`).
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from multiprocessing import get_context, parent_process
from pathlib import Path

import torch
from threadpoolctl import threadpool_limits

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import FAILED, StoppedError, WorkError
from shared_schema.common.files import require_writable
from shared_schema.common.machine import largest_resident, require_memory
from shared_schema.common.progress import Progress
from shared_schema.layout import Arrays
from shared_schema.manifest import Manifest, SolverRecord, write_manifest
from shared_schema.samples.journal import Interruption, Journal
from shared_schema.samples.results import Result, result_arrays
from shared_schema.stiffness import write_stiffness
from surrogate.mechanics.sampling.sampled_body import SampledBody, software

AT_A_TIME = 128  # samples that a worker takes


@checked_arguments
def sample(
    body: Path | str,
    out: Path | str,
    count: int,
    *,
    seed: int | None = None,
    workers: int = 1,
) -> Manifest:
    """Make the nodal dataset of a body, or resume it.

    Load cases are drawn as the body's case says, those of `datagen run` with the same seed, and
    the equilibria are those of the finite elements.

    Parameters
    ----------
    body : Path or str
        A dataset of the body, such as the folder that `datagen body` makes.
    out : Path or str
        Folder of the dataset.
    count : int
        Number of samples. A complete dataset can grow by further ones.
    seed : int, optional
        Of the loads; that of the case by default.
    workers : int
        Processes that solve. A script that asks for several is imported by each of them: what it
        does stands under ``if __name__ == "__main__":``.

    Raises
    ------
    InputError
        If there is no such body, its case asks for what the learner does not solve, or the folder
        belongs to another case.
    WorkError
        If no load case has an equilibrium.
    StoppedError
        After SIGINT or SIGTERM; solved samples are kept.
    """
    given = Path(body), count, seed
    sampled = SampledBody.read(*given)
    settings, size = sampled.case.dataset, sampled.body.geometry.coordinates.size
    what = f"count {count}: a shard of {settings.shard_size} samples"
    require_memory(24.0 * size * min(settings.shard_size, count), what, "count")
    require_writable(Path(out))
    journal = Journal(Path(out), sampled.case, "surrogate sample")
    journal.open()
    try:
        remaining = journal.remaining()
        with (
            Interruption() as interruption,
            closing(_results(given, remaining, workers, sampled)) as results,
        ):
            _write(journal, sampled, remaining, results, lambda: interruption.asked)
        if interruption.asked:
            raise StoppedError
        manifest = _finish(journal, sampled)
    finally:
        journal.close()
    if manifest.samples == 0:
        raise WorkError(f"{out}: none of the {manifest.failed} load cases has an equilibrium")
    return manifest


def _write(
    journal: Journal,
    sampled: SampledBody,
    remaining: Mapping[int, Sequence[int]],
    results: Iterable[tuple[int, Result]],
    stopped: Callable[[], bool],
) -> None:
    """Write shards as their samples come, and what is there of others at the end."""
    total, cell_type = sampled.case.dataset.samples, sampled.body.geometry.cell_type
    done, failed = total - sum(map(len, remaining.values())), 0
    found: dict[int, list[Result]] = {shard: [] for shard in remaining}
    progress = Progress(total, done, "samples", f"surrogate sample {sampled.case.content['name']}")

    shapes = sampled.body.geometry.shapes

    def arrays(shard: int) -> Arrays:
        return {**sampled.mesh, **result_arrays(sampled.loads, found.pop(shard), shapes)}

    def finish(shard: int) -> None:
        if len(found[shard]) == len(remaining[shard]) and not journal.extends(shard):
            journal.finish(shard, [*journal.parts(shard), arrays(shard)], cell_type)

    try:
        for shard, numbers in remaining.items():
            if not numbers:  # all of them are in parts
                finish(shard)
        for shard, result in results:
            found[shard].append(result)
            done, failed = done + 1, failed + (not result.report.solved)
            progress.update(done, f"{failed} failed" if failed else "")
            finish(shard)
            if stopped():
                break
    finally:
        for shard in [shard for shard, some in found.items() if some]:
            journal.keep_part(shard, arrays(shard), cell_type)
        progress.close()


def _finish(journal: Journal, sampled: SampledBody) -> Manifest:
    """Write stiffness and manifest, unless the dataset is complete already."""
    case, shards = sampled.case, journal.all_shards()
    manifest = journal.complete_manifest(shards)
    if manifest is None:
        body, history = sampled.body, journal.history
        checksum, stiffness = journal.stiffness, sampled.stiffness
        if checksum is None and stiffness is not None:
            digest = history[0].case_digest if history else case.digest()
            of = digest, body.geometry.cell_type, case.units
            checksum = write_stiffness(journal.folder, stiffness, *of)
        solver = SolverRecord(
            linear_solver="carried compliance",
            unknowns=body.equilibrium.free.size,
            memory=largest_resident() or None,
            stability="follow",
            imperfection=case.content.get("solver", {}).get("imperfection", 0),
        )
        manifest = write_manifest(
            journal.folder,
            Manifest(
                kind="nodal",
                name=case.content["name"],
                case=case.plain(),
                case_digest=case.digest(),
                seed=case.dataset.seed,
                units=case.units.labels,
                software=software(),
                dimension=body.geometry.dimension,
                samples=sum(entry.samples for entry in shards),
                failed=sum(entry.failed for entry in shards),
                history=history,
                shards=shards,
                stiffness=checksum,
                solver=solver,
                forces=sampled.forces,
            ),
        )
    journal.remove()
    return manifest


def _results(
    given: tuple[Path, int, int | None],
    remaining: Mapping[int, Sequence[int]],
    workers: int,
    sampled: SampledBody,
) -> Generator[tuple[int, Result], None, None]:
    """Solve in this process or others, and yield the shard of each sample and what is found."""
    pieces = [
        (shard, numbers[start : start + AT_A_TIME])
        for shard, numbers in remaining.items()
        for start in range(0, len(numbers), AT_A_TIME)
    ]
    if workers == 1:
        for shard, numbers in pieces:
            yield from ((shard, result) for result in sampled.solved(numbers))
        return
    with ProcessPoolExecutor(workers, get_context("spawn"), _begin, given) as pool:
        try:
            every = pool.map(_solved, [numbers for _, numbers in pieces])
            for (shard, _), found in zip(pieces, every, strict=True):
                yield from ((shard, result) for result in found)
        finally:
            pool.shutdown(cancel_futures=True)


_sampled: SampledBody  # of a worker


def _begin(folder: Path, samples: int, seed: int | None) -> None:
    """Read the body in a worker, which ends with its parent alone."""
    global _sampled
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    torch.set_num_threads(1)
    threadpool_limits(1)  # of the libraries of NumPy and SciPy: a worker is for one core
    _sampled = SampledBody.read(folder, samples, seed)


def _end_with_parent() -> None:
    if (parent := parent_process()) is not None:
        parent.join()
        os._exit(FAILED)


def _solved(numbers: Sequence[int]) -> list[Result]:
    return list(_sampled.solved(numbers))
