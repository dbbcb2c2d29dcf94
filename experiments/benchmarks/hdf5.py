"""Throughput of writing and reading shards, compared with plain files on the same disk.

The shards are a nodal and a structured one of beam3d. `write_shard`, which synchronises the file
with the disk, is compared with a plain write and fsync of the same bytes; `read_shard` with a plain
read of the same bytes. The page cache is dropped before either read. All are timed alternately, in
several rounds.

    python -m experiments benchmark hdf5

writes its record and its page.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path

import numpy as np
from mpi4py import MPI

from datagen import Case, read_case, run, structure
from experiments.benchmarks.benchmark import Benchmark, Results
from experiments.framework.report import markdown_table
from experiments.framework.timing import timed
from shared_schema import Arrays, Kind, read_shard, write_shard
from shared_schema.common import Parser

MB = 1e6


def make_shards(case: Case, folder: Path) -> dict[Kind, Path]:
    """Make the first shard of a case, nodal and structured."""
    run(case, folder / "nodal", comm=MPI.COMM_SELF)
    structure(folder / "nodal", folder / "structured")
    return {kind: folder / kind / "shard-00000.h5" for kind in ("nodal", "structured")}


def plain_write(path: Path, content: bytes) -> None:
    """Write a file and synchronise it with the disk."""
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def drop_from_cache(path: Path) -> None:
    """Drop a file from the page cache, so that the next read comes from the disk."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def solving_time(shard: Path) -> float:
    """Total wall time of solving the samples of a nodal shard, in s."""
    return float(read_shard(shard, "nodal")["samples/wall_time"].sum())


def throughput(case: Case, kind: Kind, shard: Path, folder: Path, rounds: int) -> Results:
    """Time writing and reading one shard and plain files of the same bytes."""
    arrays: Arrays = read_shard(shard, kind)
    content = shard.read_bytes()
    ours, plain = folder / f"{kind}.h5", folder / f"{kind}.bin"
    cell_type, digest = "hexahedron", case.digest()

    def one_round() -> tuple[float, ...]:
        _, write = timed(lambda: write_shard(ours, kind, arrays, digest, cell_type))
        _, plain_writing = timed(lambda: plain_write(plain, content))
        drop_from_cache(ours)
        drop_from_cache(plain)
        _, read = timed(lambda: read_shard(ours, kind))
        _, plain_reading = timed(plain.read_bytes)
        _, cached = timed(lambda: read_shard(ours, kind))
        for path in (ours, plain):
            path.unlink()
        return write, plain_writing, read, plain_reading, cached

    one_round()  # warms up
    times = np.array([one_round() for _ in range(rounds)])
    megabytes = len(content) / MB
    rates = np.median(megabytes / times, axis=0)
    names = ("write", "plain_write", "read", "plain_read", "read_from_cache")
    return {
        "kind": kind,
        "samples": len(arrays["samples/number"]),
        "megabytes": round(megabytes, 3),
        **{f"{name}_mb_per_s": round(float(r), 1) for name, r in zip(names, rates, strict=True)},
        "write_ms": round(1e3 * float(np.median(times[:, 0])), 2),
        "write_ratio": round(float(np.median(times[:, 1] / times[:, 0])), 3),
        "read_ratio": round(float(np.median(times[:, 3] / times[:, 2])), 3),
    }


def page(results: Results) -> str:
    """Make the page."""
    shards = results["shards"]
    rows = markdown_table(
        ("shard", "MB", "write", "plain", "ratio", "read", "plain", "ratio", "read, cached"),
        (
            (
                r["kind"],
                f"{r['megabytes']:.2f}",
                f"{r['write_mb_per_s']:.0f}",
                f"{r['plain_write_mb_per_s']:.0f}",
                f"**{r['write_ratio']:.2f}**",
                f"{r['read_mb_per_s']:.0f}",
                f"{r['plain_read_mb_per_s']:.0f}",
                f"**{r['read_ratio']:.2f}**",
                f"{r['read_from_cache_mb_per_s']:.0f}",
            )
            for r in shards
        ),
    )
    return (
        f"A shard of `beam3d` ({shards[0]['samples']} samples, 4032 nodes, 3 components), written "
        "by `write_shard` and read by `read_shard`,\ncompared with a plain write and fsync and a "
        "plain read of the same bytes. All are timed alternately; the page\ncache is dropped "
        "before reading. Values are MB of the file per second, medians of "
        f"{results['rounds']} rounds; at a ratio of\n1 a shard is as fast as the plain file. "
        "`write_shard` also checks every array and computes the file's SHA-256;\n`read_shard` also "
        "checks every array.\n\n"
        f"{rows}\nThe nodal shard is written in {shards[0]['write_ms']:.0f} ms; its samples took "
        f"{results['solving_s']:.0f} s to solve.\n"
    )


def measure(options: argparse.Namespace) -> Results:
    """Results for both kinds of shards."""
    case = read_case("beam3d", samples=options.samples)
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        made = make_shards(case, folder)
        solving = solving_time(made["nodal"])
        shards = [
            throughput(case, kind, shard, folder, options.rounds) for kind, shard in made.items()
        ]
    return {
        "rounds": options.rounds,
        "solving_s": round(solving, 2),
        "shards": shards,
    }


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--samples", type=int, default=50, help="number of samples of the shard")
    parser.add_argument("--rounds", type=int, default=30)
    parser.add_argument("--folder", type=Path, help="on the disk to be timed (default: /tmp)")


BENCHMARK = Benchmark(
    name="hdf5",
    title="Throughput of writing and reading shards",
    measure=measure,
    page=page,
    arguments=arguments,
)
