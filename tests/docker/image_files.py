"""Content of the image files and the Makefile, read from their text."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
IMAGES = ("datagen", "surrogate")


def instructions(image: str) -> list[tuple[str, str]]:
    """Instructions of a Dockerfile with their arguments, continued lines joined."""
    text = (ROOT / f"docker/{image}.Dockerfile").read_text()
    lines = re.sub(r"\\\n\s*", "", re.sub(r"^#.*\n", "", text, flags=re.M)).splitlines()
    return [(name, rest) for name, _, rest in (line.partition(" ") for line in lines) if name]


def installed(image: str, program: str) -> list[str]:
    """Packages that a Dockerfile installs by name with ``apt-get`` or ``pip``."""
    words: list[str] = []
    for name, arguments in instructions(image):
        if name == "RUN":
            for found in re.findall(rf"{program} install([^&]*)", arguments):
                words += re.sub(r"--constraint \S+", "", found).split()
    return [word for word in words if word[0].isalpha()]


def constraints() -> dict[str, str]:
    """Versions in ``constraints.txt`` by package."""
    lines = (ROOT / "docker" / "constraints.txt").read_text().splitlines()
    pairs = (line.split("==") for line in lines if not line.startswith("#"))
    return {plain(name): version for name, version in pairs}


def plain(package: str) -> str:
    """The one spelling of a package's name."""
    return re.sub(r"[-_.]+", "-", package).lower()


def project(package: str) -> dict[str, Any]:
    """The table ``project`` of a package's ``pyproject.toml``."""
    content = tomllib.loads((ROOT / package / "pyproject.toml").read_text())
    table: dict[str, Any] = content["project"]
    return table


def make(*words: str) -> str:
    """Output of ``make`` without variables from the environment."""
    return subprocess.run(
        ["make", "--no-print-directory", *words],
        cwd=ROOT,
        env={"PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()


def make_variable(name: str) -> str:
    """Value of a variable of the Makefile."""
    return make("--eval", f"show: ; @echo '$({name})'", "show")
