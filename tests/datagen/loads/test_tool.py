"""Balls that are pressed into the surface: poses, and what a dataset holds of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mpi4py import MPI

from datagen import solve
from datagen.cases.body import Body, make_body
from datagen.cases.case import Case
from shared_schema.checker import check_dataset
from shared_schema.common.errors import InputError
from shared_schema.dataset_reader import DatasetReader
from shared_schema.tools import Sphere
from tests.datagen.farm_runs import execute

PRESS = {"family": "tool", "radius": [0.2, 0.4], "depth": [0.02, 0.1]}
BEAM = {
    "name": "pressed",
    "mesh": {"kind": "box", "lower": [0, 0], "upper": [4, 1], "elements": [16, 3]},
    "material": {"young_modulus": 500, "poisson_ratio": 0.4},
    "supports": [{"x": 0}],
    "load": PRESS,
    "dataset": {"samples": 4, "seed": 8, "shard_size": 4},
}
BOX = {"kind": "box", "lower": [0, 0, 0], "upper": [2, 1, 1], "elements": [4, 3, 3]}


def body_of(**changes: Any) -> Body:
    return make_body(Case.model_validate(BEAM | changes), MPI.COMM_SELF)


def tools_of(body: Body, count: int = 100) -> list[Sphere]:
    drawn = [body.loads[number].tool for number in range(count)]
    assert all(tool is not None for tool in drawn)
    return [tool for tool in drawn if tool is not None]


@pytest.mark.parametrize("mesh", [BEAM["mesh"], BOX], ids=["plane", "space"])
def test_balls_come_down_along_the_normal(mesh: dict[str, Any]) -> None:
    """The deepest node of a flat face is the drawn one, at a depth of the range."""
    body = body_of(mesh=mesh)
    x, upper = body.mesh.coordinates, np.array(mesh["upper"])
    depths, radii = [], []
    for tool in tools_of(body):
        gap, centre = tool.gap(x), np.array(tool.begin)
        node = int(gap.argmin())
        depths.append(-gap[node])
        radii.append(tool.radius)
        along = (centre - x[node]) / (tool.radius + gap[node])
        assert np.linalg.norm(along) == pytest.approx(1)
        outside = (x[node] == 0) * -1 + (x[node] == upper)
        assert (along * outside)[outside != 0].min() > 0
        assert np.abs(along[outside == 0]).max(initial=0) == pytest.approx(0, abs=1e-12)
        assert gap[body.clamped].min() > 0
    assert 0.02 <= min(depths) < 0.03
    assert 0.09 < max(depths) <= 0.1 + 1e-12
    assert 0.2 <= min(radii) < 0.22
    assert 0.38 < max(radii) <= 0.4
    assert body.loadable.sum() == len(body.surface) - body.clamped.sum()


def test_tilted_balls() -> None:
    """About one node of the upper face, whose normal is upwards."""
    mesh = {"kind": "box", "lower": [0, 0], "upper": [4, 1], "elements": [4, 2]}
    body = body_of(mesh=mesh, load=PRESS | {"tilt": 40, "region": {"x": 2, "y": 1}})
    angles = []
    for tool in tools_of(body, 200):
        x, y = np.array(tool.begin) - (2, 1)
        assert 0.02 <= tool.radius - np.hypot(x, y) <= 0.1
        angles.append(np.rad2deg(np.arctan2(x, y)))
    assert -40 < min(angles) < -35
    assert 35 < max(angles) < 40


def test_dataset_holds_forces_and_poses(tmp_path: Path) -> None:
    """Under the recorded forces alone, the body is in the same equilibrium."""
    case = tmp_path / "case.yaml"
    case.write_text(yaml.safe_dump(BEAM))
    result = execute(0, case, tmp_path / "nodal")
    assert result.returncode == 0, result.stderr
    assert check_dataset(tmp_path / "nodal") == []
    names = ("loaded_nodes", "force", "displacement", "tool", "penetration", "number")
    found = DatasetReader(tmp_path / "nodal").joined(tuple(f"samples/{name}" for name in names))
    x = body_of().mesh.coordinates
    assert len(found["samples/number"]) == 4
    for nodes, force, u, pose, depth in zip(
        *(found[f"samples/{n}"] for n in names[:5]), strict=True
    ):
        forces = np.zeros(x.shape)
        forces[nodes[nodes >= 0]] = force[nodes >= 0]
        assert forces.any()
        alone = solve(case, forces).displacement
        assert np.abs(alone - u).max() < 1e-7
        tool = Sphere(tuple(pose[:2]), pose[2])
        assert depth == pytest.approx(max(0.0, -tool.gap(x + u).min()), abs=1e-12)
        assert depth < 1e-8


@pytest.mark.parametrize(
    ("load", "said"),
    [
        (PRESS | {"depth": [-0.1, 0.1]}, "depths of 0 m"),
        (PRESS | {"radius": [0.4, 0.2]}, "low < high"),
        (PRESS | {"region": {"x": "> 0.1", "y": "0.2 .. 0.8", "boundary": False}}, "region"),
        ([PRESS, PRESS], "two families with a tool"),
        (PRESS | {"radius": 50.0, "depth": [0.05, 0.1], "region": {"x": 2, "y": 1}}, "supports"),
    ],
)
def test_what_is_refused(load: Any, said: str) -> None:
    with pytest.raises((InputError, ValueError), match=said):
        body_of(load=load).loads[0]
