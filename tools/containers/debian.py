"""Run README's two commands on a bare Debian, from a clean clone, in a folder made by debootstrap.

    make test-debian SUITE=trixie [SAMPLES=120] [TESTS=test]

SUITE is bookworm (Debian 12), trixie (13), or sid for the factory alone. The system has nothing but
apt, git, make and certificates, and what pip reads on this machine: settings, a certificate,
folders of packages. It is removed at the end.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import socket
import sys
from pathlib import Path

from tools.containers.bare_debian import (
    ROOT,
    FailedError,
    execute,
    install_missing,
    make_base,
    run_to_the_end,
    step,
    temporary_folder,
)

SUITE = os.environ.get("SUITE", "trixie")
SAMPLES = os.environ.get("SAMPLES") or "120"
LEARNER = SUITE != "sid"  # whose Python is newer than the learner's tested range
TESTS = os.environ.get("TESTS") or ("test-all" if LEARNER else "test-datagen")
SETTINGS = (Path("/etc/pip.conf"), Path.home() / ".config" / "pip" / "pip.conf")
MOUNTED = ("proc", "sys", "dev", "dev/pts", "dev/shm")
PROJECT = "root/project"
VERSIONS = """
import sys, dolfinx, gmsh, mpi4py.MPI as MPI, numpy
from petsc4py import PETSc
petsc = '.'.join(map(str, PETSc.Sys.getVersion()))
print('Python', sys.version.split()[0] + ', dolfinx', dolfinx.__version__ + ', PETSc', petsc
      + ', gmsh', gmsh.__version__ + ', NumPy', numpy.__version__ + ',',
      MPI.Get_library_version().split(',')[0])
"""


def pip_variables() -> dict[str, str]:
    """Variables that pip reads."""
    return {name: value for name, value in os.environ.items() if name.startswith("PIP_")}


def make_system(base: Path) -> None:
    """Make the system, with what pip reads, and clone the last commit into it."""
    make_base(base, SUITE, include="ca-certificates,git,make")
    execute("mount", "--bind", base, base)  # programs that mount need a root that is a mount
    if Path("/etc/resolv.conf").exists():
        (base / "etc/resolv.conf").write_text(Path("/etc/resolv.conf").read_text())
    names = f"127.0.0.1\tlocalhost\n127.0.1.1\t{socket.gethostname()}\n"
    (base / "etc/hosts").write_text(names)  # as the installer of Debian does
    for point in MOUNTED:
        (base / point).mkdir(exist_ok=True)
        execute("mount", "--bind", f"/{point}", base / point)
    texts = list(pip_variables().values())
    for path in SETTINGS:
        if path.is_file():
            texts.append(path.read_text())
            inside = base / (
                "etc/pip.conf" if path.parts[1] == "etc" else "root/.config/pip/pip.conf"
            )
            inside.parent.mkdir(parents=True, exist_ok=True)
            inside.write_text(texts[-1])
    for name in sorted(set(re.findall(r"(?:^|[\s=]|file://)(/[^\s:]+)", "\n".join(texts)))):
        path = Path(name)
        share(path.parent if path.name == "simple" else path, base)  # files lie beside an index
    execute("git", "clone", "--quiet", "--no-local", ROOT, base / PROJECT)


def share(path: Path, base: Path) -> None:
    """Copy a file into the system, or show a folder there, read only, under the same name."""
    inside = base / path.relative_to("/")
    if path.is_dir():
        inside.mkdir(parents=True, exist_ok=True)
        execute("mount", "--bind", "-o", "ro", path, inside)
    elif path.is_file():
        inside.parent.mkdir(parents=True, exist_ok=True)
        inside.write_bytes(path.read_bytes())


def inside(base: Path, *words: str) -> str:
    """Run a command in the clone, as root of the system; return its output."""
    command = f"cd /{PROJECT} && {shlex.join(words)}"
    variables = {
        "HOME": "/root",
        "LANG": "C.UTF-8",
        "PATH": "/usr/sbin:/usr/bin:/sbin:/bin",
        **pip_variables(),
    }
    settings = [f"{name}={value}" for name, value in variables.items()]
    return execute("chroot", base, "env", "-i", *settings, "sh", "-c", command)


def check_demo(base: Path) -> str:
    """Check that the demo made a report; return the mean error."""
    run = base / PROJECT / "runs" / f"beam2d-linear-fast-{SAMPLES}"
    if "Surrogate of beam2d" not in (run / "report.html").read_text():
        raise FailedError(f"no report of beam2d in {run}")
    error = json.loads((run / "evaluation.json").read_text())["test"]["mean_error"]
    return f"mean error {error:.1e} m"


def outcome(said: str) -> str:
    """Numbers of tests that passed, from the last lines of pytest."""
    return "; ".join(re.findall(r"^=* ?(\d+ passed.*? in [\d.]+s)", said, re.MULTILINE))


def main() -> None:
    """Run all steps in turn."""
    torch = [f"TORCH={os.environ['TORCH']}"] if os.environ.get("TORCH") else []
    with temporary_folder("test-debian-") as folder:
        base = folder / "debian"
        with step("tools"):
            install_missing("debootstrap", "git")
        with step(f"bare {SUITE}, clone"):
            make_system(base)
        setup = "setup" if LEARNER else ".venv-datagen/.installed"
        with step(f"make {setup}") as remarks:
            inside(base, "make", setup, *torch)
            remarks.append(inside(base, ".venv-datagen/bin/python", "-c", VERSIONS))
        if LEARNER:
            with step(f"make demo, {SAMPLES} samples") as remarks:
                inside(base, "make", "demo", f"SAMPLES={SAMPLES}", "MODEL=linear", *torch)
                remarks.append(check_demo(base))
        with step(f"make {TESTS}") as remarks:
            chosen = [f"T={os.environ['T']}"] if os.environ.get("T") else []
            remarks.append(outcome(inside(base, "make", TESTS, *chosen, *torch)))


if __name__ == "__main__":
    if os.geteuid() != 0:
        sys.exit("test-debian: this needs root, to make a Debian system and to change into it")
    run_to_the_end("test-debian", main)
