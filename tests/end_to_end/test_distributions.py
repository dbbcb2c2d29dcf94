"""The wheels hold all that the packages need; `test_pip_alone` installs and runs them."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
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


def test_versions_are_one() -> None:
    versions = {datagen.__version__, shared_schema.__version__, surrogate.__version__}
    for part in PARTS:
        project = tomllib.loads((ROOT / part / "pyproject.toml").read_text())["project"]
        versions.add(project["version"])
        contract = [d for d in project["dependencies"] if d.startswith("solid-schema")]
        assert contract == ([] if part == "shared_schema" else ["solid-schema==1.0.*"])
    versions.add(yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"])
    (version,) = versions
    newest = re.search(r"^## \[(\d+\.\d+\.\d+)\]", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert newest is not None
    assert newest[1] == version
    for file in ("docker/datagen.Dockerfile", "docker/surrogate.Dockerfile"):
        assert f'image.version="{version}"' in (ROOT / file).read_text()
