"""The wheels hold all that the packages need, and run without the sources."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

import datagen
import shared_schema
import surrogate
from tools.wheels import build

ROOT = Path(__file__).parents[2]
PARTS = {"shared_schema": "schema", "datagen": "datagen", "surrogate": "surrogate"}
WEB, BUNDLE = "surrogate/page/web/", "surrogate/page/bundle/"
NOT_PACKED = ("pyproject.toml", "README.md", "requirements.txt", "requirements-alone.txt")


def sources(part: str) -> set[str]:
    """Files of a package that git has, by their path in a wheel."""
    listed = subprocess.run(
        ["git", "ls-files", part], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return {line for line in listed.stdout.split() if Path(line).name not in NOT_PACKED}


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Wheels as `python -m tools.wheels` builds them, but with this environment's setuptools."""
    folder = tmp_path_factory.mktemp("dist")
    build(folder, "--no-isolation")
    return {part: next(folder.glob(f"solid_{name}-*.whl")) for part, name in PARTS.items()}


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
def test_every_source_is_in_the_wheel(wheels: dict[str, Path], part: str) -> None:
    """All modules, shipped cases, configurations, trained networks, templates and scales.

    The page is in the wheel as npm bundles it, where it is or there is npm, instead of its sources.
    """
    packed = {name for name in zipfile.ZipFile(wheels[part]).namelist() if ".dist-info" not in name}
    bundle = {name for name in packed if name.startswith(BUNDLE)}
    assert packed - bundle == {name for name in sources(part) if not name.startswith(WEB)}
    is_made = shutil.which("npm") is not None or (ROOT / BUNDLE / "page.js").is_file()
    assert (f"{BUNDLE}page.js" in bundle) == (part == "surrogate" and is_made)
    if bundle:
        bill = json.loads(zipfile.ZipFile(wheels[part]).read(f"{BUNDLE}sbom.cdx.json"))
        names = {component["name"] for component in bill["components"]}
        assert {"three", "onnxruntime-web"} <= names
        said = zipfile.ZipFile(wheels[part]).read(f"{BUNDLE}licences.txt").decode()
        assert all(name in said for name in names)


@pytest.mark.slow
def test_they_run_without_the_sources(wheels: dict[str, Path], tmp_path: Path) -> None:
    """Lists, keys and a prediction, from another folder; dolfinx is not here."""
    for wheel in wheels.values():
        zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}

    def run(*words: str) -> str:
        done = subprocess.run(
            [sys.executable, "-m", *words],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "beam2d_any" in run("datagen.command_line", "list")
    assert "U-Net, 2 levels" in run("surrogate.command_line", "list")
    load = ("--load", "0.088,0.01,0.008:0.1,0,0.1", "--nearest")  # of a network: compiles little
    said = run("surrogate.command_line", "predict", "finger3d", *load, "--out", "u.npz")
    assert "u.npz: largest displacement 13 mm at (0.088, 0, 0.007947) m; predicted" in said


def test_versions_are_one() -> None:
    versions = {datagen.__version__, shared_schema.__version__, surrogate.__version__}
    for part in PARTS:
        project = tomllib.loads((ROOT / part / "pyproject.toml").read_text())["project"]
        versions.add(project["version"])
        contract = [d for d in project["dependencies"] if d.startswith("solid-schema")]
        assert contract == ([] if part == "shared_schema" else ["solid-schema==0.2.*"])
    versions.add(yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"])
    (version,) = versions
    newest = re.search(r"^## \[(\d+\.\d+\.\d+)\]", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert newest is not None
    assert newest[1] == version
    for file in ("docker/datagen.Dockerfile", "docker/surrogate.Dockerfile"):
        assert f'image.version="{version}"' in (ROOT / file).read_text()
