"""Datasets whose samples have shapes of their own: one mesh, moved with the parameters."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import datagen
from datagen.farm.shard_job import ShardJob
from shared_schema.common.bodies.shape_family import ShapeFamily
from shared_schema.common.errors import InputError, StoppedError
from shared_schema.content_problems import content_problems
from shared_schema.dataset_reader import DatasetReader
from tests.datagen.farm.test_body_dataset import CASE, PLATE
from tests.datagen.farm_runs import assert_same

RANGES = {"radius": [0.2, 0.3], "width": [1.8, 2.2]}
FAMILY: dict[str, Any] = {
    **CASE,
    "mesh": {"kind": "file", "path": "plate.geo", "parameters": RANGES},
    "load": {"family": "random_node", "region": {"x": "> 0.9"}, "range": [-3, 2]},
    "dataset": {"samples": 6, "shard_size": 3, "seed": 1},
}


@pytest.fixture
def plate(tmp_path: Path) -> Path:
    script = PLATE.replace("MeshSizeMax = 0.2", "MeshSizeMax = 0.3")
    (tmp_path / "plate.geo").write_text(script)
    (tmp_path / "plate.yaml").write_text(yaml.safe_dump(FAMILY))
    return tmp_path / "plate.yaml"


def test_every_sample_is_the_equilibrium_of_its_shape(plate: Path, tmp_path: Path) -> None:
    manifest = datagen.run(plate, tmp_path / "data")
    assert (manifest.samples, manifest.failed, manifest.stiffness) == (6, 0, None)
    assert datagen.check(tmp_path / "data") == []
    assert datagen.info(tmp_path / "data")["parameter width"] == "1.8 to 2.2"
    reader = DatasetReader(tmp_path / "data")
    names = "parameters", "coordinates", "loaded_nodes", "force", "displacement"
    found = reader.joined([f"samples/{name}" for name in names])
    parameters, x, nodes, force, u = (found[f"samples/{name}"] for name in names)
    radius, width = parameters.T
    assert ((radius >= 0.2) & (radius <= 0.3)).all()
    assert np.ptp(width) > 0.1
    assert x[:, :, 0].max(axis=1) == pytest.approx(width, rel=1e-12)
    middle = np.stack([width / 2, np.full(6, 0.5)], axis=1)
    nearest = np.linalg.norm(x - middle[:, None], axis=2).min(axis=1)
    assert nearest == pytest.approx(radius, rel=1e-12)  # nodes of the hole stay on the circle
    load = np.zeros(x.shape[1:])
    load[nodes[4, 0]] = force[4, 0]
    shape = {"radius": radius[4], "width": width[4]}
    solution = datagen.solve(plate, load, parameters=shape)
    assert solution.displacement == pytest.approx(u[4], abs=1e-10)
    structured = datagen.structure(tmp_path / "data", tmp_path / "grid", grid="nodes")
    assert structured.stiffness_checksum is None
    assert datagen.check(tmp_path / "grid") == []
    family = ShapeFamily.of_arrays(DatasetReader(tmp_path / "grid").body)
    assert family is not None
    assert np.array_equal(family.coordinates(parameters[2]), x[2])


def test_what_does_not_fit_a_shape_is_found(plate: Path, tmp_path: Path) -> None:
    manifest = datagen.run(plate, tmp_path / "data", samples=3)
    arrays = DatasetReader(tmp_path / "data").shard(manifest.shards[0])
    assert content_problems(manifest, arrays) == []
    for name, change, said in (
        ("samples/coordinates", 1e-6, "'samples/coordinates' is not the shape of"),
        ("samples/parameters", 0.5, "outside of its range"),
        ("mesh/shape_terms", 1e-6, "does not begin with 'mesh/coordinates'"),
    ):
        (found,) = content_problems(manifest, {**arrays, name: arrays[name] + change})
        assert said in found
    del arrays["samples/parameters"]
    (found,) = content_problems(manifest, arrays)
    assert "do not stand together" in found


def test_stopped_and_resumed_is_uninterrupted(
    plate: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    datagen.run(plate, tmp_path / "whole")
    whole, solve_next = tmp_path / "whole", ShardJob.solve_next

    def stop(job: ShardJob) -> bool:
        if job.number == 4:
            os.kill(os.getpid(), signal.SIGTERM)
        return solve_next(job)

    with monkeypatch.context() as patch:
        patch.setattr(ShardJob, "solve_next", stop)
        with pytest.raises(StoppedError):
            datagen.run(plate, tmp_path / "stopped")
    datagen.run(plate, tmp_path / "stopped")
    assert_same(whole, tmp_path / "stopped")


def test_a_tangled_sample_is_recorded(
    plate: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = ShapeFamily.problem

    def tangled(shapes: ShapeFamily, values: Any, *mesh: Any) -> str | None:
        is_fifth = np.array_equal(values, shapes.drawn(1, 4))
        return "cell 3 nearly flat" if is_fifth else problem(shapes, values, *mesh)

    monkeypatch.setattr(ShapeFamily, "problem", tangled)
    manifest = datagen.run(plate, tmp_path / "data")
    assert (manifest.samples, manifest.failed) == (5, 1)
    assert datagen.info(tmp_path / "data")["failed: cell 3 nearly flat"] == "1"
    assert datagen.check(tmp_path / "data") == []


@pytest.mark.parametrize(
    ("ranges", "said"),
    [
        ({"radius": [0.3, 0.2]}, r"key 'mesh\.parameters\.radius': expected \[low, high\]"),
        ({"radius": [0.01, 0.4]}, r"key 'mesh\.parameters': radius = 0\.01: .* nearly flat"),
        ({"radius": [0.2, 0.6]}, r"key 'mesh\.parameters': radius = 0\.6: the geometry has other"),
        ({"size": [0.2, 0.6]}, r"key 'mesh\.parameters\.size': 'plate\.geo' defines radius, width"),
    ],
)
def test_wrong_ranges_are_refused(
    plate: Path, tmp_path: Path, ranges: dict[str, Any], said: str
) -> None:
    plate.write_text(yaml.safe_dump({**FAMILY, "mesh": {**FAMILY["mesh"], "parameters": ranges}}))
    with pytest.raises(InputError, match=said):
        datagen.run(plate, tmp_path / "data")
    assert not (tmp_path / "data").exists()


def test_wrong_parameters_are_refused(plate: Path) -> None:
    for given, said in (
        ({"depth": 1.0}, "parameter depth=1.0: no such parameter, expected radius, width"),
        ({"radius": 0.6}, r"parameter radius = 0\.6, width = 2: .* turned over"),
    ):
        with pytest.raises(InputError, match=said):
            datagen.solve(plate, "2,0:0,-1", parameters=given)
    with pytest.raises(InputError, match="parameter radius: the case's mesh has no ranges"):
        datagen.solve("beam2d", "4,1:0,-1", parameters={"radius": 1.0})


BLOCK = """// A block with a round channel through it, in tetrahedra. Lengths in m.
SetFactory("OpenCASCADE");
DefineConstant[ x = 0.05, radius = 0.012 ];
Box(1) = {0, 0, 0, 0.1, 0.06, 0.03};
Cylinder(2) = {x, 0.03, -1, 0, 0, 2, radius};
BooleanDifference(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
Mesh.MeshSizeMax = 0.015;
Mesh.MeshSizeMin = 0.015;
"""
BRICK = """// A brick of hexahedra. Lengths in m.
DefineConstant[ length = 2 ];
Point(1) = {0, 0, 0}; Point(2) = {length, 0, 0};
Line(1) = {1, 2}; Transfinite Curve{1} = 4;
made[] = Extrude{0, 1, 0}{ Curve{1}; Layers{2}; Recombine; };
Extrude{0, 0, 1}{ Surface{made[1]}; Layers{2}; Recombine; }
"""


def test_surfaces_in_space_keep_their_form(tmp_path: Path) -> None:
    (tmp_path / "block.geo").write_text(BLOCK)
    ranges = {"x": [0.045, 0.055], "radius": [0.010, 0.014]}
    mesh = {"kind": "file", "path": str(tmp_path / "block.geo"), "parameters": ranges}
    raw = datagen.read_case({**CASE, "mesh": mesh, "supports": [{"x": 0}]}).mesh.raw_mesh()
    assert raw.shapes is not None
    reference = np.hypot(raw.coordinates[:, 0] - 0.05, raw.coordinates[:, 1] - 0.03)
    channel = np.flatnonzero(np.abs(reference - 0.012) < 1e-9)
    assert len(channel) > 20
    for x, radius in ((0.045, 0.014), (0.052, 0.0105)):
        moved = raw.shapes.coordinates(np.array([x, radius]))
        found = np.hypot(moved[channel, 0] - x, moved[channel, 1] - 0.03)
        assert found == pytest.approx(radius, rel=1e-4)
        assert moved.max(axis=0) == pytest.approx([0.1, 0.06, 0.03], rel=1e-12)


def test_meshes_of_the_same_cells_are_taken_as_they_are(tmp_path: Path) -> None:
    (tmp_path / "brick.geo").write_text(BRICK)
    mesh = {
        "kind": "file",
        "path": str(tmp_path / "brick.geo"),
        "scale": 0.1,
        "parameters": {"length": [1, 4]},
    }
    raw = datagen.read_case({**CASE, "mesh": mesh, "supports": [{"x": 0}]}).mesh.raw_mesh()
    assert raw.shapes is not None
    assert raw.cell_type == "hexahedron"
    moved = raw.shapes.coordinates(np.array([1.0]))
    expected = raw.coordinates * [1 / 2.5, 1, 1]
    assert moved == pytest.approx(expected, abs=1e-12)
