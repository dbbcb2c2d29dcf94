"""Datasets of bodies without samples: the body of a dataset, of every shape of a script."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mpi4py import MPI

import datagen
from datagen.cases.body import Body
from datagen.command_line import main
from shared_schema.common.errors import InputError
from shared_schema.dataset_reader import DatasetReader
from tests.datagen.farm_runs import write_case

PLATE = """// A plate with a hole. Lengths in m.
SetFactory("OpenCASCADE");
// DefineConstant[ other = 1 ];
DefineConstant[ radius = {0.3, Min 0.1, Max 0.4, Name "Plate/radius, in m"}, width = 2 ];
Rectangle(1) = {0, 0, 0, width, 1};
Disk(2) = {width / 2, 0.5, 0, radius};
BooleanDifference{ Surface{1}; Delete; }{ Surface{2}; Delete; }
Mesh.MeshSizeMax = 0.2;
"""
CASE: dict[str, Any] = {
    "name": "plate",
    "mesh": {"kind": "file", "path": "plate.geo"},
    "material": {"young_modulus": 500, "poisson_ratio": 0.4, "volumetric": "paper"},
    "supports": [{"x": 0}],
    "load": {"family": "random_node", "region": {"x": "> 0.9"}, "range": [-3, 2]},
    "dataset": {"samples": 10, "seed": 1},
}


@pytest.fixture
def plate(tmp_path: Path) -> Path:
    (tmp_path / "plate.geo").write_text(PLATE)
    (tmp_path / "plate.yaml").write_text(yaml.safe_dump(CASE))
    return tmp_path / "plate.yaml"


def hole_of(case: Path, out: Path, *changes: str) -> float:
    """Distance from the middle of the plate to the nearest node."""
    datagen.body(case, out, changes=changes)
    nodes = DatasetReader(out).body["mesh/coordinates"]
    return float(np.linalg.norm(nodes - [1, 0.5], axis=1).min())


def test_body_is_that_of_the_samples(beam: Body, tmp_path: Path) -> None:
    manifest = datagen.body("beam2d", tmp_path / "body")
    assert datagen.check(tmp_path / "body") == []
    reader = DatasetReader(tmp_path / "body", "structured")
    expected, found = beam.shard_arrays(), reader.body
    for name, values in expected.items():
        assert np.array_equal(found[name], values), name
    assert (manifest.samples, manifest.failed, reader.cell_type) == (0, 0, "quad")
    assert manifest.structured is not None
    assert manifest.structured.grid_shape == (16, 4) == found["grid/mask"].shape
    largest = manifest.structured.force.max_abs  # of 100 load cases, evenly drawn from 0 to 2.5 N
    assert all(0.9 * 2.5 < value <= 2.5 for value in largest)


def test_every_shape_of_a_script_is_a_body(plate: Path, tmp_path: Path) -> None:
    assert hole_of(plate, tmp_path / "wide") == pytest.approx(0.3)
    assert hole_of(plate, tmp_path / "narrow", "mesh.parameters.radius=0.15") == pytest.approx(0.15)
    body = DatasetReader(tmp_path / "narrow")
    assert body.manifest.case["mesh"]["parameters"] == {"radius": 0.15}
    nodes = len(body.body["mesh/coordinates"])
    assert body.body["grid/mask"].shape == (nodes, 1)  # in a row
    assert datagen.info(tmp_path / "narrow")["samples"] == "0 solved, 0 failed"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("mesh.parameters.other=1", "'plate.geo' defines radius, width, expected a constant"),
        ("mesh.parameters.radius=big", "key 'mesh.parameters.radius' = 'big'"),
        ("mesh.parameters.radius=0.6", "key 'supports"),
        ("load={family: given, file: none.h5}", "none.h5"),
    ],
)
def test_wrong_shapes_are_refused(plate: Path, tmp_path: Path, change: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        datagen.body(plate, tmp_path / "body", changes=[change])
    assert not (tmp_path / "body").exists()


def test_parameters_are_those_of_scripts(tmp_path: Path) -> None:
    mesh = {"kind": "file", "path": "plate.msh", "parameters": {"radius": 1}}
    with pytest.raises(InputError, match=r"'parameters' of 'plate\.msh': expected none"):
        datagen.read_case({**CASE, "mesh": mesh})


def test_load_without_a_force_is_refused(tmp_path: Path) -> None:
    moved = "load={family: displacement, region: {x: 4}, range: [-0.1, 0.1]}"
    with pytest.raises(InputError, match="key 'load': no load case has a force"):
        datagen.body("beam2d", tmp_path / "body", changes=[moved])


def test_what_needs_samples_refuses_a_body(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    body, nodal, other = (str(tmp_path / name) for name in ("body", "nodal", "other"))
    assert main(["body", "beam2d", "--out", body]) == 0
    assert main(["body", "beam2d", "--out", body]) == 0  # the same again
    assert capsys.readouterr().out.splitlines()[0] == f"{body}: body of beam2d, without samples"
    assert main(["structure", body, "--out", other]) == 2
    assert "a structured dataset, expected a nodal one" in capsys.readouterr().err
    file = str(write_case(tmp_path, samples=2))
    datagen.run(file, nodal, comm=MPI.COMM_SELF)
    assert main(["body", file, "--out", nodal]) == 2
    assert "holds a dataset of 2 samples" in capsys.readouterr().err
