"""A compilation that was killed leaves a file, for which FFCx would wait."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from datagen import dolfinx_versions
from datagen.compiled_cache import remove_stale_locks
from shared_schema.common.errors import WorkError


@pytest.fixture
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setattr(dolfinx_versions, "_cache", lambda: tmp_path)
    return tmp_path


def left(cache: Path, name: str, age: float) -> Path:
    """Leave the file of a kernel that was begun some seconds ago."""
    file = cache / f"libffcx_forms_{name}.c"
    file.touch()
    os.utime(file, (time.time() - age,) * 2)
    return file


def test_the_file_to_delete_is_named(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def waits(*_: Any, **__: Any) -> None:
        raise TimeoutError("JIT compilation timed out, try removing /cache/lib.c")

    monkeypatch.setattr("dolfinx.fem.form", waits)
    with pytest.raises(WorkError, match=r"was killed: JIT compilation .* /cache/lib\.c$"):
        dolfinx_versions.form(None, {})
    stale = left(cache, "of_another_kernel", 1000.0)
    with pytest.raises(WorkError):
        dolfinx_versions.form(None, {})
    assert not stale.exists()


def test_what_nobody_compiles_is_removed(cache: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Not what is young or finished, nor a kernel that a compiler runs on."""
    _, young = left(cache, "stale", 1000.0), left(cache, "young", 10.0)
    finished, compiled = left(cache, "finished", 1000.0), left(cache, "compiled", 1000.0)
    finished.with_suffix(".c.cached").touch()
    wait = [sys.executable, "-c", "input()", compiled.name]
    with subprocess.Popen(wait, stdin=subprocess.PIPE) as compiler:
        while not Path(f"/proc/{compiler.pid}/cmdline").read_bytes().endswith(b".c\0"):
            time.sleep(0.01)  # until the process has its own command line
        with caplog.at_level(logging.WARNING):
            assert remove_stale_locks(cache, 120.0)
            assert not remove_stale_locks(cache, 120.0)
        compiler.communicate(b"\n")
    assert sorted(cache.glob("*.c")) == sorted([young, finished, compiled])
    (text,) = caplog.messages
    assert text.startswith(f"removed 1 unfinished kernels, left in '{cache}'")


def test_a_solve_goes_on_after_the_time_out(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the process that compiled had been killed just before: FFCx waits, and then works."""
    stale = left(cache, "stale", 1000.0)

    def compiles(*_: Any, **__: Any) -> str:
        if stale.exists():
            raise TimeoutError("JIT compilation timed out")
        return "compiled"

    monkeypatch.setattr("dolfinx.fem.form", compiles)
    assert dolfinx_versions.form(None, {}) == "compiled"
    assert not stale.exists()
