"""Case files: the shipped cases, wrong ones, each refused in one line, and the keys of all."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from jsonschema import Draft202012Validator
from mpi4py import MPI

from datagen.cases.body import make_body
from datagen.cases.case import SHIPPED, read_case
from datagen.cases.case_schema import case_keys, case_schema
from datagen.command_line import main
from datagen.solver.load_stepping import solve_load_case
from shared_schema.actuators import pressed
from shared_schema.common.configuration import read_yaml
from shared_schema.common.errors import InputError
from shared_schema.materials import NeoHookean
from tests.datagen.refusal import refusal

Content = dict[str, Any]
SCHEMA = case_schema()
UNITS = {
    "mesh.lower": "m",
    "mesh.block.height": "m",
    "material.young_modulus": "Pa",
    "solver.tolerance": "N",
    "load.force": "N",
    "load.radius": "m",
    "dataset.samples": "",
}


def written(folder: Path, content: Content) -> str:
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(content))
    return str(path)


@pytest.fixture
def content() -> Content:
    loaded: Content = yaml.safe_load((SHIPPED / "beam2d.yaml").read_text())
    return loaded


def test_beam2d_is_the_papers() -> None:
    """Table 'datasets' of the paper: ±2.5 N, 5700 + 300 samples; E = 0.5 kPa, ν = 0.4."""
    case = read_case("beam2d")
    assert case.dataset.samples == 6000
    assert round(case.dataset.test_fraction * case.dataset.samples) == 300
    assert case.material == NeoHookean(young_modulus=500, poisson_ratio=0.4, volumetric="paper")
    body = make_body(case, MPI.COMM_SELF)
    assert body.mesh.coordinates.size == 128
    assert (body.clamped.sum(), body.loadable.sum()) == (4, 15)


@pytest.mark.parametrize(
    ("name", "clamped", "loadable", "largest"),
    [
        ("beam2d_any", 4, 60, 2.0),
        ("lshape2d_any", 4, 76, 0.8),
        ("beam3d_any", 144, 1288, 2.0),  # 28 · 12² − 26 · 10² nodes of the surface, 12² clamped
    ],
)
def test_any_load(name: str, clamped: int, loadable: int, largest: float) -> None:
    """One to four forces on any nodes that are not clamped, in space on those of the surface."""
    case = read_case(name)
    body = make_body(case, MPI.COMM_SELF)
    assert (body.clamped.sum(), body.loadable.sum()) == (clamped, loadable)
    loads = [case.loads[0].draw(n, case.dataset.seed, body.loads.loadable) for n in range(400)]
    assert {len(load.nodes) for load in loads} == {1, 2, 3, 4}
    forces = np.abs(np.concatenate([load.forces for load in loads]))
    assert 0.99 * largest < forces.max() <= largest


@pytest.mark.slow
def test_soft_finger() -> None:
    """Inflated, the finger bends downwards; pushed as well, it moves by a third of its length."""
    case = read_case("finger3d")
    body = make_body(case, MPI.COMM_SELF)
    x, tip = body.mesh.coordinates, np.argmax(body.mesh.coordinates[:, 0])
    assert body.mesh.cell_type == "hexahedron"
    assert 1500 <= len(x) <= 4000
    np.testing.assert_allclose(np.ptp(x, axis=0), (0.088, 0.02, 0.016), rtol=1e-3)
    assert np.all(x[body.clamped, 0] == 0)
    nothing = np.empty(0, dtype=int), np.empty((0, 3))
    assert solve_load_case(body.problem, *nothing, case.solver, pressed([1500.0])).solved
    inflated = body.problem.displacement()
    assert inflated[tip, 2] < -0.02
    assert abs(inflated[:, 1].mean()) < 1e-8  # the middle of its width is a plane of symmetry
    moved = []
    for number in range(2):
        load = body.loads[number]
        assert len(load.nodes) == 1
        assert 0 < load.pressures[0] < 1500
        report = solve_load_case(body.problem, load.nodes, load.forces, case.solver, load.controls)
        assert report.solved
        moved.append(np.linalg.norm(body.problem.displacement(), axis=1).max())
    assert 2e-3 < np.median(moved) < 0.03


def test_name_and_path_are_the_same_case() -> None:
    assert read_case("beam2d") == read_case(str(SHIPPED / "beam2d.yaml"))


def test_replacements() -> None:
    case = read_case("beam2d", volumetric="quadratic", samples=12)
    assert isinstance(case.material, NeoHookean)
    assert (case.material.volumetric, case.dataset.samples) == ("quadratic", 12)
    assert case.digest() != read_case("beam2d").digest()


def test_changed_keys() -> None:
    """The manifest stores what `plain` returns; --samples goes before --set."""
    changes = ("material.young_modulus=1e3", "supports.0.x=4", "dataset.samples=5")
    case = read_case("beam2d", samples=12, changes=changes)
    assert case.plain()["material"]["young_modulus"] == 1000
    assert case.supports[0].x == 4
    assert case.dataset.samples == 12
    with pytest.raises(
        InputError, match=r"--set material\.young_modulus=soft: key 'material\.young"
    ):
        read_case("beam2d", changes=["material.young_modulus=soft"])


@pytest.mark.parametrize(
    ("keys", "value", "said"),
    [
        (("material", "young_modulus"), -500, r"key 'material.young_modulus' = -500: .*greater"),
        (
            ("material", "poisson_ratio"),
            0.5,
            r"key 'material.poisson_ratio' = 0.5: .*less than 0.5",
        ),
        (("material", "poisson_ratio"), -1, "greater than -1"),
        (("material", "weight"), 1000, "unknown key 'material.weight'"),
        (("material", "volumetric"), "cubic", "'paper' or 'quadratic'"),
        (("colour",), "red", "unknown key 'colour'"),
        (("load", "range"), [1, -1], "low < high"),
        (("load", "family"), "wind", "load family 'wind'"),
        (("load", "nodes"), 3, "unknown key 'load.nodes'"),
        (("mesh", "elements"), [15, 0], "greater than 0"),
        (("mesh", "upper"), [4, 1, 1], "of the same length"),
        (("solver", "tolerance"), float("nan"), "finite"),
        (("dataset", "samples"), 0, "greater than 0"),
        (("dataset", "seed"), "tuesday", "integer"),
        (("supports",), [], "the body can move and turn freely, expected a list of at least one"),
    ],
)
def test_wrong_values_are_named(
    tmp_path: Path, content: Content, keys: tuple[str, ...], value: Any, said: str
) -> None:
    section = content
    for key in keys[:-1]:
        section = section[key]
    section[keys[-1]] = value
    with pytest.raises(InputError, match=said) as error:
        read_case(written(tmp_path, content))
    assert "\n" not in str(error.value)


def test_missing_key(tmp_path: Path, content: Content) -> None:
    del content["material"]["poisson_ratio"]
    with pytest.raises(InputError, match=r"key 'material.poisson_ratio' is missing"):
        read_case(written(tmp_path, content))


@pytest.mark.parametrize("text", ["[1, 2", "- a\n- b", "", "name: {"])
def test_file_without_a_mapping(tmp_path: Path, text: str) -> None:
    path = tmp_path / "case.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"case\.yaml"):
        read_case(str(path))


def test_no_such_case() -> None:
    with pytest.raises(InputError, match=r"beam2d"):
        read_case("beam9d")


@pytest.mark.parametrize(
    ("key", "region", "said"),
    [
        ("load", {"y": 1}, "clamped node at 0,1"),
        ("load", {"y": 3}, "no node of the mesh"),
        ("supports", {"x": -1}, "no node of the mesh"),
    ],
)
def test_regions_that_do_not_fit_the_mesh(
    tmp_path: Path, content: Content, key: str, region: Content, said: str
) -> None:
    if key == "load":
        content["load"]["region"] = region
    else:
        content["supports"] = [region]
    with pytest.raises(InputError, match=said):
        make_body(read_case(written(tmp_path, content)), MPI.COMM_SELF)


def test_every_key_has_a_meaning() -> None:
    assert [key.name for key in case_keys() if not key.meaning] == []


def test_units() -> None:
    assert {key.name: key.unit for key in case_keys() if key.name in UNITS} == UNITS
    ranges = {key.only: key.unit for key in case_keys() if key.name == "load.range"}
    assert ranges["family: random_node | random_nodes"] == "N"
    assert ranges["family: traction_patch"] == "Pa"


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_cases_are_valid(path: Path) -> None:
    Draft202012Validator(SCHEMA).validate(read_yaml(path))


def test_wrong_cases_are_not() -> None:
    validator, content = Draft202012Validator(SCHEMA), read_yaml(SHIPPED / "beam2d.yaml")
    for section, key, value in (
        ("material", "poisson_ratio", 0.5),
        ("material", "poisson", 0.3),
        ("dataset", "samples", "6"),
        ("load", "family", "random"),
        ("mesh", "kind", "sphere"),
    ):
        wrong = {**content, section: {**content[section], key: value}}
        assert not validator.is_valid(wrong), key
    own = {**content["load"], "family": "push.py:Push", "newtons": 3.0}
    assert validator.is_valid({**content, "load": own})


def test_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema", "solver.tolerance"]) == 0
    line, meaning = capsys.readouterr().out.splitlines()
    assert line == "solver.tolerance: number ≥ 1e-300, ≤ 1e+12 or null in N; default null"
    assert meaning.startswith("    Absolute tolerance on the 2-norm of the residual, in N")
    assert main(["schema", "--format", "json"]) == 0
    assert json.loads(capsys.readouterr().out) == SCHEMA
    assert main(["schema"]) == 0
    assert "in mm with stresses in Pa describes a body that" in capsys.readouterr().out
    assert "KEY 'solver.tol': no such key, expected one of name, mesh" in refusal(
        ["schema", "solver.tol"], capsys
    )
