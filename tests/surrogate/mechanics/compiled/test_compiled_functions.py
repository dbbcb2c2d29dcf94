"""Functions that two processes compile at the same time are kept one beside the other."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from surrogate.mechanics.compiled.fields import Array, compiled, inner

FUNCTIONS = """
from surrogate.mechanics.compiled.fields import compiled, inner

@inner
def product_of(a, b):
    return a * b

def times(factor):
    @compiled
    def product(x):
        return product_of(factor, x)
    return product
"""
COMPILES = """
import sys, time
from numba.core.caching import IndexDataCacheFile
from kept import times

factor, *pauses = map(float, sys.argv[1:])

def with_pauses(save, before, after):
    def paused(self, *what):
        time.sleep(before)
        save(self, *what)
        time.sleep(after)
    return paused

IndexDataCacheFile._save_index = with_pauses(IndexDataCacheFile._save_index, *pauses)
product = times(factor)
print("ready", flush=True)
sys.stdin.readline()
product(1.0)
"""
PAUSES = {"3": ("2", "3"), "5": ("3", "0")}  # before and after the list is replaced, in s


CALLER = """
import sys
from pathlib import Path
from surrogate.mechanics.compiled import fields

fields.SOURCES = Path(__file__).parent
from part import factor

@fields.compiled
def product(x):
    return factor() * x
"""
PART = """
from surrogate.mechanics.compiled.fields import inner

@inner
def factor():
    return {}
"""


def test_a_part_that_changes_is_compiled_again(tmp_path: Path) -> None:
    """Numba itself looks at the caller's file alone."""
    (tmp_path / "caller.py").write_text(CALLER)
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"PYTHONPATH": path, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    told = "import logging; logging.basicConfig(level=logging.INFO); "
    call = "from caller import product; print(product(1.0))"
    command = [sys.executable, "-B", "-c", told + call]
    for factor, says in (("2.0", True), ("3.25", True), ("3.25", False)):
        (tmp_path / "part.py").write_text(PART.format(factor))
        os.utime(tmp_path / "part.py", (0, 0))  # its size or its time tells a change
        found = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        assert found.stdout == f"{float(factor)}\n"
        assert ("code is compiled" in found.stderr) == says


@pytest.mark.slow
def test_two_processes_compile_at_once(tmp_path: Path) -> None:
    """Both read the list before either replaces it, and one writes its code last of all."""
    (tmp_path / "kept.py").write_text(FUNCTIONS)
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"PYTHONPATH": path, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    command = [sys.executable, "-c"]
    at_once = [
        subprocess.Popen(
            [*command, COMPILES, factor, *pauses],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            text=True,
        )
        for factor, pauses in PAUSES.items()
    ]
    for process in at_once:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in at_once:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    assert [process.wait() for process in at_once] == [0, 0]
    reads = "from kept import times; print(times(3.0)(1.0), times(5.0)(1.0))"
    found = subprocess.run(
        [*command, reads], env=environment, capture_output=True, text=True, check=True
    )
    assert found.stdout.split() == ["3.0", "5.0"]


FORKS = """
import gc
import os
from kept import times

product = times(3.0)
child = os.fork()
if child == 0:
    product(1.0)
    os._exit(0)
_, status = os.waitpid(child, 0)
print(os.waitstatus_to_exitcode(status), product(1.0))
"""


def test_a_forked_process_compiles(tmp_path: Path) -> None:
    """A process that is forked after the import keeps what it compiles, as its parent does."""
    (tmp_path / "kept.py").write_text(FUNCTIONS)
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"PYTHONPATH": path, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    found = subprocess.run(
        [sys.executable, "-c", FORKS], env=environment, capture_output=True, text=True, check=True
    )
    assert found.stdout.split() == ["0", "3.0"]


def test_a_part_is_compiled_within_its_callers() -> None:
    """By hand: 2 (1 + 2 + 3) = 12; Python runs the part itself, and looks for garbage after."""

    @inner
    def sum_of(values: Array) -> float:
        total = 0.0
        for value in values:
            total += value
        return total

    @compiled
    def twice(values: Array) -> float:
        return 2 * sum_of(values)

    values = np.array([1.0, 2.0, 3.0])
    assert twice(values) == 12
    assert sum_of(values) == 6
    assert gc.isenabled()
