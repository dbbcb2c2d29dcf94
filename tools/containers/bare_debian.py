"""A bare Debian in a folder, made by debootstrap, for tests that start from an empty machine.

Everything lies in one temporary folder, which is removed at the end, also after a failure.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


class FailedError(Exception):
    """A step failed; the message is the reason."""


def execute(*words: str | Path, environment: Mapping[str, str] | None = None, code: int = 0) -> str:
    """Run a command to its end and return its output; an exception ends the command first.

    Raises
    ------
    FailedError
        If the exit code is not `code`; the message has the last lines of the output.
    """
    process = subprocess.Popen(
        [str(word) for word in words],
        cwd=ROOT,
        env={**os.environ, **(environment or {})},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    )
    try:
        said, _ = process.communicate()
    except BaseException:
        os.killpg(process.pid, signal.SIGTERM)
        try:
            process.wait(timeout=30)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
        raise
    if process.returncode != code:
        tail = "\n".join(said.splitlines()[-40:])
        command = " ".join(map(str, words))
        raise FailedError(f"exit code {process.returncode}, expected {code}: {command}\n{tail}")
    return said.strip()


@contextmanager
def step(what: str) -> Iterator[list[str]]:
    """Print the name of a step, its time, and the remarks that the step adds to the list."""
    print(f"{what:.<40s} ", end="", flush=True)
    began = time.monotonic()
    remarks: list[str] = []
    try:
        yield remarks
    except BaseException:
        print("failed")
        raise
    print(f"{time.monotonic() - began:5.0f} s  {', '.join(remarks)}", flush=True)


@contextmanager
def temporary_folder(prefix: str) -> Iterator[Path]:
    """Make a folder; at the end remove it with its containers and mounts, ignoring signals."""
    folder = Path(tempfile.mkdtemp(prefix=prefix, dir=os.environ.get("TMPDIR", "/var/tmp")))
    try:
        yield folder
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        with step("clean up"):
            if (podman := folder / "bin" / "podman").exists():
                execute(podman, "rm", "--all", "--force", "--depend", "--time=0")
            for mount in reversed(mounts_below(folder)):
                execute("umount", "--lazy", mount)
            if still := mounts_below(folder):
                raise FailedError(f"not removed, since there are mounts in it: {still}")
            shutil.rmtree(folder)


def mounts_below(folder: Path) -> list[str]:
    """List the mount points in a folder, in the order of mounting."""
    points = [line.split()[4] for line in Path("/proc/self/mountinfo").read_text().splitlines()]
    return [point for point in points if point.startswith(f"{folder}/")]


def install_missing(*packages: str) -> None:
    """Install those Debian packages that are missing on this machine."""
    installed = {
        package: subprocess.run(["dpkg", "-s", package], capture_output=True).returncode == 0
        for package in packages
    }
    execute("apt-get", "update", "-q")
    if missing := [package for package, there in installed.items() if not there]:
        options = ("-qy", "--no-install-recommends")
        quiet = {"DEBIAN_FRONTEND": "noninteractive"}
        execute("apt-get", "install", *options, *missing, environment=quiet)


def make_base(base: Path, suite: str, include: str = "") -> None:
    """Make a bare Debian from the mirrors of this machine's apt, and with apt's settings.

    Parameters
    ----------
    base : Path
        Folder to make.
    suite : str
        Debian's release, such as ``trixie``. This machine may have another; its mirrors are taken.
    include : str
        Packages to add to the smallest system, separated by commas.
    """
    own = next(
        line.partition("=")[2]
        for line in Path("/etc/os-release").read_text().splitlines()
        if line.startswith("VERSION_CODENAME=")
    )
    release = ("Created-By: Packages", "Origin: Debian")
    line = "deb $(REPO_URI) $(RELEASE) $(COMPONENT)"
    found = sorted(set(execute("apt-get", "indextargets", "--format", line, *release).split("\n")))
    mirrors = [source.split()[1] for source in found if source.split()[2] == own]
    if not mirrors:
        raise FailedError(f"apt knows no mirror of {own}")
    if suite == "sid":  # which has no updates of its own
        sources = [f"deb {mirrors[0]} sid main"]
    else:
        sources = [source.replace(f" {own}", f" {suite}") for source in found]
    more = [f"--include={include}"] if include else []
    execute("debootstrap", "--variant=minbase", *more, suite, base, mirrors[0])
    (base / "etc/apt/sources.list").write_text("\n".join(sources) + "\n")
    (base / "etc/apt/apt.conf.d/00host").write_text(execute("apt-config", "dump", "Acquire") + "\n")
    (base / "etc/resolv.conf").unlink(missing_ok=True)


def stop(number: int, frame: object) -> None:
    """Turn a signal into an exception."""
    raise KeyboardInterrupt


def run_to_the_end(name: str, main: Callable[[], None]) -> None:
    """Run a test, which a signal may stop, and say in a last line how it ended.

    Raises
    ------
    SystemExit
        If the test failed or was stopped.
    """
    signal.signal(signal.SIGTERM, stop)
    try:
        main()
    except FailedError as error:
        raise SystemExit(f"{name}: failed: {error}") from None
    except KeyboardInterrupt:
        raise SystemExit(f"{name}: stopped") from None
    print(f"{name}: passed")
