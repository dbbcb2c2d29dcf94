"""Helpers that run `datagen` as its users do, with or without mpirun, and compare datasets."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from datagen.cases.case import SHIPPED
from shared_schema.checker import check_dataset
from shared_schema.layout import NODAL
from shared_schema.manifest import read_manifest
from shared_schema.shard import read_shard
from shared_schema.stiffness import STIFFNESS_FILE
from tools.open_mpi import SETTINGS

# waits before the next sample when some shards are finished, until it is asked to stop or the file
# with the name of its first argument is removed
HELD = """
import sys, time
from pathlib import Path
from datagen.command_line import main
from shared_schema.samples.journal import Interruption
from datagen.farm.shard_job import ShardJob
gate, shards = Path(sys.argv[1]), int(sys.argv[2])
del sys.argv[1:3]
asked, note, solve_next = [], Interruption._note, ShardJob.solve_next
def note_and_go_on(interruption, *of_signal):
    asked.append(True)
    note(interruption, *of_signal)
def wait_and_solve(job):
    journal = Path(sys.argv[sys.argv.index("--out") + 1]) / ".journal"
    while gate.exists() and not asked and len(list(journal.glob("shard-*.json"))) >= shards:
        time.sleep(0.01)
    return solve_next(job)
Interruption._note, ShardJob.solve_next = note_and_go_on, wait_and_solve
sys.exit(main())
"""
LAUNCHERS = (b"mpirun", b"prterun")  # Open MPI 5's mpirun turns into the second
TIMES = {"samples/wall_time"}  # the only array that may differ
ENVIRONMENT = os.environ | SETTINGS


def write_case(folder: Path, samples: int = 120, shard_size: int = 25, **load: Any) -> Path:
    content = yaml.safe_load((SHIPPED / "beam2d.yaml").read_text())
    content["dataset"] |= {"samples": samples, "shard_size": shard_size}
    content["load"] |= load
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def datagen(*words: str | Path, ranks: int = 0) -> list[str]:
    program = [sys.executable, "-m", "datagen.command_line", *map(str, words)]
    mpirun = ["mpirun", "-n", str(ranks)]
    return [*mpirun, *program] if ranks else program


def command(ranks: int, case: Path, out: Path) -> list[str]:
    return datagen("run", case, "--out", out, ranks=ranks)


def held(words: list[str], gate: Path, shards: int = 5) -> list[str]:
    """The same command, which waits when some shards are finished, until `gate` is removed."""
    gate.touch()
    program = words.index("-m")
    return [*words[:program], "-c", HELD, str(gate), str(shards), *words[program + 2 :]]


def finish(words: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        words, env=ENVIRONMENT, capture_output=True, text=True, check=False, timeout=120
    )


def execute(ranks: int, case: Path, out: Path, *more: str) -> subprocess.CompletedProcess[str]:
    return finish([*command(ranks, case, out), *more])


def start(words: list[str]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        words, env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )


def wait_until(condition: Callable[[], bool], process: subprocess.Popen[Any]) -> None:
    limit = time.monotonic() + 120
    while not condition():
        assert process.poll() is None, "ended too early"
        assert time.monotonic() < limit
        time.sleep(0.01)


def recorded(folder: Path) -> int:
    """Number of shards that the journal of a run records as finished."""
    return len(list((folder / ".journal").glob("shard-*.json")))


def pids_of(out: Path) -> list[int]:
    """Find the processes of datagen that write to a folder, without mpirun itself."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes().split(b"\0")
        except OSError:
            continue
        if str(out).encode() in words and words[0].rpartition(b"/")[2] not in LAUNCHERS:
            found.append(int(path.parent.name))
    return sorted(found)


def all_end(out: Path, within: float) -> bool:
    """Return True if no process writes to a folder any more, after some seconds at most."""
    limit = time.monotonic() + within
    while pids_of(out) and time.monotonic() < limit:
        time.sleep(0.01)
    return not pids_of(out)


def assert_same(one: Path, other: Path) -> None:
    """Assert that stiffness and shards are equal to the last bit, except times."""
    files = one / STIFFNESS_FILE, other / STIFFNESS_FILE  # none of a family of shapes
    first, second = (path.read_bytes() if path.exists() else None for path in files)
    assert first == second
    shards = [entry.file for entry in read_manifest(one).shards]
    assert shards == [entry.file for entry in read_manifest(other).shards]
    for name in shards:
        a, b = read_shard(one / name, "nodal"), read_shard(other / name, "nodal")
        for layout in NODAL:
            if layout.path not in TIMES and (layout.path in a or not layout.optional):
                assert np.array_equal(a[layout.path], b[layout.path]), (name, layout.path)


def assert_near(one: Path, other: Path) -> None:
    """Assert equal mesh, stiffness, sample numbers, loads, and displacements equal to 1e-10 m."""
    assert check_dataset(other) == []
    files = one / STIFFNESS_FILE, other / STIFFNESS_FILE  # none of a family of shapes
    first, second = (path.read_bytes() if path.exists() else None for path in files)
    assert first == second
    for path in sorted(one.glob("shard-*.h5")):
        a, b = read_shard(path, "nodal"), read_shard(other / path.name, "nodal")
        for name in ("mesh/coordinates", "mesh/cells", "samples/loaded_nodes", "samples/force"):
            assert np.array_equal(a[name], b[name])
        assert np.abs(a["samples/displacement"] - b["samples/displacement"]).max() < 1e-10
