"""The Dockerfiles install what the Makefile and the packages name, pinned."""

from __future__ import annotations

import re
import subprocess
from fnmatch import fnmatch
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.docker.image_files import (
    IMAGES,
    ROOT,
    constraints,
    installed,
    instructions,
    make_variable,
    plain,
    project,
)

EXTRAS = ("export", "tensorboard")  # of surrogate: features of its commands
SUITE = "trixie"
TESTED_WITH = {
    "jsonschema",
    "pytest",
    "pytest-timeout",
    "pytest-xdist",
    "scikit-fem",
}  # no image needs them


def requirements() -> dict[str, list[Requirement]]:
    """Requirements that pip installs by name, for each image."""
    surrogate, contract = project("surrogate"), project("shared_schema")
    lines = [*surrogate["dependencies"], *contract["dependencies"]]
    for extra in EXTRAS:
        lines += surrogate["optional-dependencies"][extra]
    ours = {"solid-schema", "torch"}  # the one from its folder, the other by TORCH
    texts = [
        (ROOT / "datagen" / name).read_text()
        for name in ("requirements.txt", "requirements-alone.txt")
    ]
    found = {
        "surrogate": [r for r in map(Requirement, lines) if plain(r.name) not in ours],
        "datagen": [Requirement(x) for x in "".join(texts).splitlines() if x[0] != "#"],
    }
    found["datagen"] = [r for r in found["datagen"] if r.name not in TESTED_WITH]
    return found


def test_debian_packages_are_those_of_the_makefile() -> None:
    names = [package.partition("=")[0] for package in installed("datagen", "apt-get")]
    assert names == make_variable("DEBIAN_PACKAGES").split()


@pytest.mark.parametrize("image", IMAGES)
def test_debian_packages_are_pinned_to_what_there_is(image: str) -> None:
    """As this machine's Debian has them, where it is that of the images and has them."""
    release = Path("/etc/os-release")
    is_same = release.is_file() and f"VERSION_CODENAME={SUITE}\n" in release.read_text()
    for package in installed(image, "apt-get"):
        name, _, version = package.partition("=")
        assert re.search(r"\d\S*-\*$", version), package
        shown = subprocess.run(
            ["dpkg-query", "-W", "-f=${Version}", name], capture_output=True, text=True
        ).stdout
        assert not (shown and is_same) or fnmatch(shown, version), (package, shown)


@pytest.mark.parametrize("image", IMAGES)
def test_python_packages_are_those_of_the_projects(image: str) -> None:
    expected = {plain(r.name) for r in requirements()[image]}
    assert sorted(installed(image, "pip")) == sorted(expected)


@pytest.mark.parametrize("image", IMAGES)
def test_pinned_versions_are_allowed(image: str) -> None:
    versions = constraints()
    for requirement in requirements()[image]:
        assert versions[plain(requirement.name)] in requirement.specifier, str(requirement)


def test_torch_is_that_of_the_makefile() -> None:
    defaults = dict(a.partition("=")[::2] for n, a in instructions("surrogate") if n == "ARG")
    assert defaults["TORCH"] == make_variable("TORCH")
    assert "torch" not in constraints()


@pytest.mark.parametrize("image", IMAGES)
def test_base_user_and_labels(image: str) -> None:
    found = instructions(image)
    assert [a for n, a in found if n == "FROM"] == [f"debian:{SUITE}-slim"]
    users = [a for n, a in found if n == "USER"]
    assert users == ["1000"]
    labels = dict(re.findall(r'org\.opencontainers\.image\.(\w+)="([^"]*)"', found[-1][1]))
    assert labels["title"] == image
    assert labels["version"] == project(image)["version"]
    assert labels["licenses"] == project(image)["license"]["text"]


@pytest.mark.parametrize("image", IMAGES)
def test_what_changes_most_comes_last(image: str) -> None:
    """So that another line of code installs no package again."""
    found = [f"{name} {arguments}" for name, arguments in instructions(image)]
    order = ["apt-get install", "COPY docker/constraints.txt", "COPY shared_schema", "ARG REVISION"]
    places = [next(i for i, x in enumerate(found) if part in x) for part in order]
    assert places == sorted(places)
    by_name = [i for i, x in enumerate(found) if re.search(r"pip install .*--constraint", x)]
    assert places[1] < min(by_name) <= max(by_name) < places[2]


@pytest.mark.parametrize("image", IMAGES)
def test_only_what_is_copied_is_sent(image: str) -> None:
    lines = (ROOT / ".dockerignore").read_text().splitlines()
    assert "*" in lines
    sent = {line[1:] for line in lines if line.startswith("!")}
    copied = {a.split()[0] for n, a in instructions(image) if n == "COPY"}
    assert copied <= sent
    assert sent - copied == {"datagen", "surrogate"} - {image}
    for path in copied:
        assert (ROOT / path).exists()
