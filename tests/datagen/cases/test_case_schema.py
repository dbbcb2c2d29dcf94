"""The keys of a case: every one has a meaning; the schema accepts what the program accepts."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from datagen.cases.case import SHIPPED
from datagen.cases.case_schema import case_keys, case_schema
from datagen.command_line import main
from shared_schema.common.configuration import read_yaml
from tests.datagen.refusal import refusal

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
