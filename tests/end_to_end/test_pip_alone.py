"""What pip installs is enough: without POSIX, without dolfinx, without a home directory."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from shared_schema.manifest import read_manifest
from tests.surrogate.conftest import build as make_dataset
from tests.surrogate.mechanics.sampling.test_sampling import LOAD
from tools.kidney import kidney
from tools.wheels import build

ROOT = Path(__file__).parents[2]
# Modules and functions that Windows does not have; what runs on every system must do without.
BLOCKED = """
import builtins, os, signal, sys, types

MODULES = {"fcntl", "grp", "posix", "pwd", "resource", "syslog", "termios"}
GONE = {
    "os": "fork forkpty getuid geteuid getgid getpgid killpg nice pread pwrite sched_getaffinity "
    "setsid statvfs uname wait4".split(),
    "signal": "SIGALRM SIGHUP SIGKILL SIGUSR1 alarm pause setitimer sigwait".split(),
}
OURS, real = ("datagen", "shared_schema", "surrogate"), builtins.__import__


def without(module):
    left = types.ModuleType(module.__name__)
    names = set(dir(module)) - set(GONE[module.__name__])
    left.__dict__.update({name: getattr(module, name) for name in names})
    return left


poorer = {module.__name__: without(module) for module in (os, signal)}


def imported(name, globals=None, locals=None, fromlist=(), level=0):
    asks = str((globals or {}).get("__name__", "")).partition(".")[0]
    if asks in OURS and name in MODULES:
        raise ModuleNotFoundError(name)
    found = real(name, globals, locals, fromlist, level)
    return poorer.get(name, found) if asks in OURS else found


builtins.__import__ = imported
"""
LEARNER = """
from pathlib import Path
import importlib

root = Path(sys.argv[1])
for part in ("shared_schema", "surrogate"):
    for file in sorted((root / part).rglob("[a-z]*.py")):
        name = ".".join(file.relative_to(root).with_suffix("").parts)
        if "node_modules" not in name and not name.startswith("surrogate.serving"):
            if name != "surrogate.page.wheel":
                importlib.import_module(name)

import surrogate
from datagen import command_line as factory
from surrogate import command_line as learner

def run(main, *words, code=0):
    found = main.main([str(word) for word in words])
    assert found == code, (words, found)

body = sys.argv[2]
run(learner, "list")
run(learner, "sample", body, "--count", 12, "--out", "nodal")
run(factory, "check", "nodal")
run(factory, "structure", "nodal", "--out", "grid")
run(factory, "run", "beam2d", "--out", "elsewhere", code=1)
run(learner, "train", "series", "--data", "grid", "--out", "run")
run(learner, "evaluate", "run", "--data", "grid")
load = "3.5,1.5:0,-1"
run(learner, "predict", "run", "--load", load, "--certify", "--correct", "--out", "u.vtu")
"""


def test_nothing_that_only_posix_has(tmp_path: Path) -> None:
    """Every module is imported, and samples lead to a network, without what Windows lacks."""
    beam = make_dataset(tmp_path / "beam", dataset={"samples": 60, "shard_size": 5}, load=LOAD)
    words = [sys.executable, "-c", BLOCKED + LEARNER, str(ROOT), str(beam)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert read_manifest(tmp_path / "nodal").samples == 12
    assert "datagen run needs dolfinx, which is not installed" in done.stderr
    assert not (tmp_path / "elsewhere").exists()


CASE = """
name: kidney
mesh: {kind: file, path: kidney.stl, size: 0.005}
material: {young_modulus: 5000, poisson_ratio: 0.45}
supports: [{x: "< -0.035"}]
load: {family: body_force, range: [-2000, 2000]}
dataset: {samples: 100, shard_size: 50}
"""


def link_what_is_needed(name: str, site: Path, seen: set[str]) -> None:
    """Link what a distribution requires, from this environment: pip takes it for installed."""
    for text in distribution(name).requires or ():
        needed = Requirement(text)
        if needed.name in seen or (needed.marker and not needed.marker.evaluate({"extra": ""})):
            continue
        seen.add(needed.name)
        try:
            found = distribution(needed.name)
        except PackageNotFoundError:  # pip fetches it
            continue
        if not needed.name.startswith("solid-"):
            for top in {file.parts[0] for file in found.files or ()} - {"..", "__pycache__"}:
                if not (site / top).exists():
                    (site / top).symlink_to(str(found.locate_file(top)))
        link_what_is_needed(needed.name, site, seen)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_from_wheels_to_the_page_of_a_surface(tmp_path: Path) -> None:
    """In a new environment, with no other program on the path and no home directory.

    It has what pip installs by the wheels' own requirements, and nothing else.
    """
    build(tmp_path / "dist", "--no-isolation")
    place = tmp_path / "environment"
    venv.create(place, with_pip=True)
    programs = place / ("Scripts" if os.name == "nt" else "bin")
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "XDG", "NUMBA"))}
    environment = {**kept, "PATH": str(programs), "HOME": str(tmp_path / "none" / "of" / "mine")}

    def run(*words: str | Path, code: int = 0) -> str:
        program = programs / str(words[0])
        done = subprocess.run(
            [str(program), *map(str, words[1:])],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == code, done.stderr
        return done.stdout + done.stderr

    site = run("python", "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip()
    link_what_is_needed("solid-surrogate", Path(site), set())
    pip = ("python", "-m", "pip", "install", "-q", "--find-links", tmp_path / "dist")
    run(*pip, "solid-datagen[mesh]", "solid-surrogate")
    run("python", "-m", "pip", "check")
    for program in ("datagen", "surrogate"):
        assert "beam2d_any" in run(program, "list")
    kidney(tmp_path / "kidney.stl")
    (tmp_path / "case.yaml").write_text(CASE, encoding="utf-8")
    run("datagen", "body", "case.yaml", "--out", "body")
    run("surrogate", "train", "series", "--data", "body", "--out", "run")
    said = run(
        "surrogate", "predict", "run", "--body-force", "0,0,-1000", "--certify", "--out", "u.vtu"
    )
    assert "largest displacement" in said
    run("surrogate", "sample", "body", "--count", "4", "--out", "nodal")
    run("datagen", "check", "nodal")
    run("surrogate", "page", "run", "--out", "kidney.html")
    assert (tmp_path / "kidney.html").stat().st_size > 1e5
    assert "needs dolfinx" in run("datagen", "run", "case.yaml", "--out", "elsewhere", code=1)
