"""Elements from the case file to the dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from datagen.cases.case import read_case
from datagen.command_line import main
from shared_schema.checker import check_dataset
from shared_schema.manifest import read_manifest
from shared_schema.shard import read_shard

CASE: dict[str, Any] = {
    "name": "silicone",
    "mesh": {"kind": "box", "lower": [0, 0], "upper": [4, 1], "elements": [12, 3]},
    "material": {"young_modulus": 500, "poisson_ratio": 0.49},
    "supports": [{"x": 0}],
    "load": {"family": "random_node", "region": {"x": 4}, "range": [-1, 1]},
    "dataset": {"samples": 4, "seed": 1, "test_fraction": 0.25},
}


def case_file(folder: Path, **changes: Any) -> str:
    path = folder / "silicone.yaml"
    path.write_text(yaml.safe_dump(CASE | changes))
    return str(path)


@pytest.mark.parametrize(
    ("name", "digest"),
    [
        ("beam2d", "91dd8ca75403cb8e5a21002f49fa3b15cc30e6be115d9cf2101e9da94ebcbd02"),
        ("lshape2d", "c310926d52b5e09cc795e284c40e2d9353e69c9fa08dbae75f10266461bb6af7"),
        ("beam3d", "3ee9df5950c6a3034c7fc1eab8dae95d4bff7552d2f56bf2f2152c8319262a9d"),
    ],
)
def test_datasets_of_the_paper_stay_those_of_their_cases(name: str, digest: str) -> None:
    """Digests from before there were other elements and tolerances."""
    assert read_case(name).digest() == digest
    assert read_case(name).solver.tolerance == 1e-8


@pytest.mark.parametrize(
    ("element", "unknowns", "has_stiffness"),
    [("quadratic", 2 * 25 * 7, False), ("incompressible", 2 * 13 * 4, True)],
)
def test_dataset_of_other_elements(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    element: str,
    unknowns: int,
    has_stiffness: bool,
) -> None:
    """Displacements of the corners; the stiffness only if there is nothing else."""
    folder = tmp_path / "nodal"
    assert main(["run", case_file(tmp_path, element=element), "--out", str(folder)]) == 0
    assert main(["structure", str(folder), "--out", str(tmp_path / "grid")]) == 0
    assert check_dataset(folder) == check_dataset(tmp_path / "grid") == []
    manifest = read_manifest(folder)
    assert manifest.case["element"] == element
    assert (manifest.stiffness is not None) == has_stiffness
    assert manifest.solver is not None
    assert manifest.solver.unknowns == unknowns
    arrays = read_shard(folder / "shard-00000.h5", "nodal")
    assert arrays["samples/displacement"].shape == (4, 52, 2)
    assert main(["info", str(folder)]) == 0
    said = capsys.readouterr().out
    assert f"{element}, {unknowns} unknowns" in said
    assert " MB a rank at most" in said


def test_solve_says_time_and_memory_and_warns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Linear elements with ν = 0.49 bend 44 % less than F-bar, as the warning says of a beam."""
    tips = {}
    for element in ("linear", "incompressible"):
        out = str(tmp_path / "solution.npz")
        load = ["--load", "4,1:0,-0.1"]
        assert main(["solve", case_file(tmp_path, element=element), *load, "--out", out]) == 0
        said = capsys.readouterr()
        assert "104 unknowns, lu: " in said.out
        assert " s a solve, " in said.out
        assert ("datagen: warning: linear elements are too stiff" in said.err) == (
            element == "linear"
        )
        with np.load(out) as file:
            tips[element] = np.abs(file["displacement"]).max()
    assert tips["linear"] < 0.7 * tips["incompressible"]


def test_a_wrong_element_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", case_file(tmp_path, element="cubic"), "--out", str(tmp_path / "n")]) == 2
    assert (
        "key 'element' = 'cubic': input should be 'linear', 'quadratic'" in capsys.readouterr().err
    )
    assert not (tmp_path / "n").exists()
