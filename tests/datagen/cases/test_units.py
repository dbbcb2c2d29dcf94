"""A case names its units, which are labels; displacements that hint at a mistake in them."""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import yaml

import datagen
from datagen.cases.case import SHIPPED, read_case
from datagen.command_line import main
from datagen.farm.farm import run
from datagen.transforms.reindexing import structure
from shared_schema.checker import check_dataset as check
from shared_schema.common.errors import InputError
from shared_schema.shard import read_shard

CASE: dict[str, Any] = {
    "name": "bar",
    "mesh": {"kind": "box", "lower": [0, 0], "upper": [40, 10], "elements": [8, 2]},
    "material": {"young_modulus": 500, "poisson_ratio": 0.4},
    "supports": [{"x": 0}],
    "load": {"family": "random_node", "region": {"x": "> 0"}, "range": [-10, 10]},
    "dataset": {"samples": 12, "seed": 1, "shard_size": 6, "test_fraction": 0.2},
    "units": {"length": "mm"},
}


def test_labels_of_a_dataset(tmp_path: Path) -> None:
    """Manifest and arrays of the nodal and the structured dataset name mm, N and MPa."""
    nodal, structured = tmp_path / "nodal", tmp_path / "structured"
    assert run(CASE, nodal).units == {"length": "mm", "force": "N", "stress": "MPa", "time": "s"}
    structure(nodal, structured)
    for folder in (nodal, structured):
        assert check(folder) == []
        assert json.loads((folder / "manifest.json").read_text())["units"]["length"] == "mm"
        with h5py.File(folder / "shard-00000.h5") as file:
            assert file["mesh/coordinates"].attrs["units"] == "mm"
            assert file["samples/force"].attrs["units"] == "N"
    with h5py.File(nodal / "shard-00000.h5", "r+") as file:
        file["mesh/coordinates"].attrs["units"] = "m"
    with pytest.raises(InputError, match="attribute 'units' is 'm', expected 'mm'"):
        read_shard(nodal / "shard-00000.h5", "nodal")


def test_labels_of_messages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    solution = datagen.solve(CASE, "40,10:0,-1", stresses=True)
    assert " mm, " in repr(solution)
    path = tmp_path / "bar.yaml"
    path.write_text(yaml.safe_dump(CASE))
    out = str(tmp_path / "out.npz")
    assert main(["solve", str(path), "--load", "40,10:0,-1", "--stresses", "--out", out]) == 0
    said = capsys.readouterr().out
    assert " mm, largest von Mises stress " in said
    assert " MPa, " in said
    run(CASE, tmp_path / "nodal")
    rows = datagen.info(tmp_path / "nodal")
    assert rows["largest |u| of a sample"].endswith(" mm")
    assert rows["force components"].endswith(" N")


def test_numbers_do_not_depend_on_labels(tmp_path: Path) -> None:
    case = {key: value for key, value in CASE.items() if key != "units"}
    some, others = run(CASE, tmp_path / "mm"), run(case, tmp_path / "m")
    assert others.units == {"length": "m", "force": "N", "stress": "Pa", "time": "s"}
    assert some.case_digest != others.case_digest
    files = [h5py.File(tmp_path / name / "shard-00000.h5") for name in ("mm", "m")]
    one, other = (file["samples/displacement"][()] for file in files)
    np.testing.assert_array_equal(one, other)
    for file in files:
        file.close()


def test_shipped_cases_keep_their_digests() -> None:
    for path in SHIPPED.glob("*.yaml"):
        assert "units" not in read_case(path.stem).plain()


@pytest.mark.parametrize(
    ("modulus", "force", "said"),
    [(500e6, 1000.0, "e-06 of the body's size, 40"), (500.0, 400.0, None), (3.0, 60.0, "size, 40")],
)
def test_displacements_of_an_unusual_size(
    modulus: float, force: float, said: str | None, caplog: pytest.LogCaptureFixture
) -> None:
    """A mesh in mm beside a modulus in Pa; another of a modulus that is far too small."""
    case = CASE | {"material": {"young_modulus": modulus, "poisson_ratio": 0.4}}
    with caplog.at_level(logging.WARNING):
        datagen.solve(case, f"40,10:{force},0")
    if said is None:
        assert not caplog.messages
    else:
        assert said in caplog.text
        assert "are the units consistent" in caplog.text


def test_first_samples_of_a_run(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    case = CASE | {"material": {"young_modulus": 500e6, "poisson_ratio": 0.4}}
    with caplog.at_level(logging.WARNING):
        run(case, tmp_path / "nodal")
    assert caplog.text.count("the largest displacement of the first 6 samples is") == 1
