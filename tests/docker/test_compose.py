"""The services of the compose file do what the Makefile's targets do."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.docker.image_files import ROOT, instructions, make, make_variable, project

STAGES = {"data": "datagen", "structure": "datagen", "train": "surrogate", "evaluate": "surrogate"}
VARIABLES = ("CASE", "MODEL", "RECIPE", "NP", "SAMPLES")
OTHER = {"CASE": "lshape2d", "MODEL": "vb", "RECIPE": "paper", "NP": "3", "SAMPLES": "120"}


def compose(environment: Mapping[str, str], name: str = "compose.yaml") -> dict[str, Any]:
    """A compose file with variables put into its strings."""

    def value(found: re.Match[str]) -> str:
        return "$" if found[0] == "$$" else environment.get(found["name"]) or found["default"]

    def filled(part: Any) -> Any:
        if isinstance(part, dict):
            return {key: filled(of) for key, of in part.items()}
        if isinstance(part, list):
            return [filled(of) for of in part]
        pattern = r"\$\$|\$\{(?P<name>\w+):-(?P<default>[^}]*)\}"
        return re.sub(pattern, value, part) if isinstance(part, str) else part

    content: dict[str, Any] = filled(yaml.safe_load((ROOT / "docker" / name).read_text()))
    return content


def commands(service: dict[str, Any], folder: Path) -> list[str]:
    """Commands of a service's shell, printed by stand-ins instead of executed."""
    for program in ("mpirun", "datagen", "surrogate"):
        path = folder / program
        path.write_text('#!/bin/sh\necho "${0##*/} $@"\n')
        path.chmod(0o755)
    said = subprocess.run(
        [*service["entrypoint"], *service["command"]],
        env={**service["environment"], "PATH": f"{folder}:/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=True,
    )
    return said.stdout.splitlines()


def commands_of_make(variables: Mapping[str, str]) -> list[str]:
    """Commands of `make report`, without folders of environments and the paper's numbers.

    These are in the checkout only (`experiments`), not in the images.
    """
    old = [f"--assume-old=.venv-{name}/.installed" for name in ("datagen", "surrogate")]
    words = [f"{name}={value}" for name, value in variables.items()]
    text = make("--dry-run", "--always-make", *old, "report", *words).replace("\\\n", " ")
    text = re.sub(r"\.venv-\w+/bin/|OMP_NUM_THREADS=1 | --beside \S+", "", text)
    lines = [re.sub(r"\s+", " ", line).strip() for line in text.splitlines()]
    return [line for line in lines if re.match("mpirun|datagen|surrogate", line)]


@pytest.mark.parametrize("variables", [{}, OTHER], ids=["defaults", "others"])
def test_commands_are_those_of_make(variables: dict[str, str], tmp_path: Path) -> None:
    services = compose(variables)["services"]
    found = [line for stage in STAGES for line in commands(services[stage], tmp_path)]
    expected = commands_of_make(variables)
    assert len(expected) == 5
    if not variables:  # its folders end in -all where those of make have no end
        found = [line.replace("-all", "") for line in found]
    assert [sorted(line.split()) for line in found] == [sorted(line.split()) for line in expected]


def test_variables_and_defaults_are_those_of_make() -> None:
    text = (ROOT / "docker" / "compose.yaml").read_text()
    defaults = dict(re.findall(r"\$\{(\w+):-([^}]*)\}", text))
    for of_builds in ("PIP_EXTRA_INDEX_URL", "REVISION"):
        del defaults[of_builds]
    defaults["SAMPLES"] = ""  # `all` in names of folders
    assert defaults == {name: make_variable(name) for name in (*VARIABLES, "TORCH")}


def test_one_stage_after_the_other_over_one_volume() -> None:
    content = compose({})
    services = content["services"]
    assert list(services) == list(STAGES)
    assert list(content["volumes"]) == ["work"]
    before: str | None = None
    for stage, service in services.items():
        image = STAGES[stage]
        assert service["image"] == f"{image}:{project(image)['version']}"
        assert service["build"]["dockerfile"] == f"docker/{image}.Dockerfile"
        assert service["volumes"] == ["work:/work"]
        assert service["network_mode"] == "none"
        done = {before: {"condition": "service_completed_successfully"}} if before else None
        assert service.get("depends_on") == done
        before = stage


def test_the_learner_gets_the_gpus() -> None:
    services = compose({}, "compose.gpu.yaml")["services"]
    assert list(services) == [stage for stage, image in STAGES.items() if image == "surrogate"]


def test_images_of_another_torch() -> None:
    arguments = compose({"TORCH": "torch==2.13.0+cpu"})["services"]["train"]["build"]["args"]
    assert arguments["TORCH"] == "torch==2.13.0+cpu"
    declared = {a.partition("=")[0] for name, a in instructions("surrogate") if name == "ARG"}
    assert set(arguments) <= declared
