"""Every requirement is held by tests that exist; the page is that of requirements and records."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.evidence.page import PAGE, page
from experiments.evidence.requirements import FILE, Requirement, read_requirements
from shared_schema.common import InputError

ONE = {
    "requirement": "Coverage is right.",
    "held": "beta",
    "tests": ["surrogate/mechanics/certify/test_conformal.py::test_marginal_coverage_is_beta"],
}


def test_page_is_that_of_requirements_and_records() -> None:
    assert PAGE.read_text() == page(read_requirements())


def test_a_requirement_without_a_test(tmp_path: Path) -> None:
    text = FILE.read_text()
    for old, new in (
        ("::test_breast_under_a_body_force", "::test_breast_that_is_not_there"),
        ("solver/test_equilibrium_by_calculix.py", "solver/test_nowhere.py"),
        ("[datagen/solver/test_equilibrium_by_calculix.py::test_breast_under_a_body_force]", "[]"),
    ):
        assert old in text
        changed = tmp_path / "requirements.yaml"
        changed.write_text(text.replace(old, new))
        with pytest.raises(InputError, match=r"no test|tests"):
            read_requirements(changed)


def test_figures() -> None:
    """From the record's numbers; without a record there is none, and half of one is an error."""
    assert Requirement.model_validate(ONE).figure() == ""
    measured = ONE | {"record": "benchmark-corrections-beam2d_any.json"}
    of = Requirement.model_validate(measured | {"measured": "{load_cases} load cases"})
    assert of.figure().startswith("200 load cases ([`")
    for wrong in (
        measured,
        measured | {"measured": "{nothing}"},
        ONE | {"record": "benchmark-none.json", "measured": "1"},
    ):
        with pytest.raises(InputError, match=r"Coverage is right"):
            Requirement.model_validate(wrong).figure()
