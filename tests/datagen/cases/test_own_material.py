"""A user's own material: found from the case file, believed only as far as it is right."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mpi4py import MPI

from datagen.cases.body import make_body
from datagen.cases.case import Case, read_case
from datagen.command_line import main
from datagen.farm.farm import run
from datagen.solver.load_stepping import solve_load_case
from shared_schema.common.errors import InputError
from shared_schema.manifest import read_manifest
from tests.datagen.refusal import refusal

CODE = """
from shared_schema import OwnMaterial


class Gel(OwnMaterial):
    shear: float
    first: float

    def energy(self, {arguments}):
        return {energy}
"""
SAME = (
    "self.shear / 2 * (c.i1 - 3 - 2 * of.ln(c.j)) + self.first / 4 * (c.j**2 - 1 - 2 * of.ln(c.j))"
)


def own_case(folder: Path, energy: str = SAME, arguments: str = "c, of", **keys: Any) -> Path:
    (folder / "gel.py").write_text(CODE.format(energy=energy, arguments=arguments))
    content = yaml.safe_load((Path("datagen/configs/beam2d.yaml")).read_text())
    lame = {"shear": 500 / 2.8, "first": 200 / (1.4 * 0.2)}
    content["material"] = {"model": "gel.py:Gel", **lame, **keys}
    content["dataset"] |= {"samples": 4, "shard_size": 4}
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def solved(case: Case) -> np.ndarray:
    body = make_body(case, MPI.COMM_SELF)
    load = body.loads[3]
    assert solve_load_case(body.problem, load.nodes, load.forces, case.solver).solved
    return body.problem.displacement()


def test_own_energy_is_solved(tmp_path: Path) -> None:
    """The Neo-Hookean energy, written by a user, has its displacements and its moduli."""
    case = read_case(str(own_case(tmp_path)))
    assert solved(case) == pytest.approx(solved(read_case("beam2d")), abs=1e-10)
    before = case.digest()
    (tmp_path / "gel.py").write_text((tmp_path / "gel.py").read_text() + "\n# changed\n")
    assert read_case(str(tmp_path / "case.yaml")).digest() != before


@pytest.mark.parametrize(
    ("energy", "said"),
    [
        ("1 / 0", "energy: ZeroDivisionError: division by zero (line 10)"),
        ("c", "energy: TypeError: "),
        ("None", "energy: TypeError: "),
        ("c.i1", "the undeformed body is under a stress of 3.4641 Pa, expected none"),
        ("of.ln(c.j - 1)", "energy: ValueError: "),
        (f"-({SAME})", "the shear modulus at rest is -178.571 Pa, expected above 0"),
        ("0.0", "the shear modulus at rest is 0 Pa, expected above 0"),
        ("self.first * (c.j - 1) ** 2", "the shear modulus at rest is 0 Pa, expected above 0"),
        ("self.shear * (c.j ** (-2 / 3) * c.i1 - 3)", "the bulk modulus at rest is "),
        (f"({SAME}) * (1 if c.j > 0.5 else 2)", "energy: TypeError: '>' not supported"),
    ],
)
def test_unfit_energies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], energy: str, said: str
) -> None:
    """Minus a Neo-Hookean energy has −μ = −500/2.8 Pa; I₁ has the stress 2 I, 2√3 on I/√3."""
    path, out = own_case(tmp_path, energy), str(tmp_path / "out.npz")
    found = refusal(["solve", str(path), "--load", "4,1:0,-1", "--out", out], capsys)
    assert said in found


def test_energies_of_tensors_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An energy W(F), as materials once were, is told what to become."""
    path, out = own_case(tmp_path, "0.0", "f"), str(tmp_path / "out.npz")
    found = refusal(["solve", str(path), "--load", "4,1:0,-1", "--out", out], capsys)
    assert (
        "key 'material.model' = 'gel.py:Gel': energy: expected the arguments (self, c, of)" in found
    )


@pytest.mark.parametrize(
    ("material", "said"),
    [
        ({"model": "rubber"}, "key 'material.model' = 'rubber': expected one of neo_hookean, "),
        ({"model": "gel.py:Gel", "shear": 1.0}, "key 'material.first' is missing"),
        ({"model": [1]}, "key 'material.model' = [1]: expected one of neo_hookean, "),
        ({"model": "none.py:Gel"}, "none.py cannot be read"),
        ({"model": "gel.py:Jelly"}, "has no class 'Jelly'"),
        ({"model": "gel.py:OwnMaterial", "shear": 1}, "material"),
        ({"model": "yeoh", "c10": 1}, "key 'material.bulk_modulus' is missing"),
    ],
)
def test_wrong_materials(tmp_path: Path, material: dict[str, Any], said: str) -> None:
    path = own_case(tmp_path)
    content = yaml.safe_load(path.read_text())
    path.write_text(yaml.safe_dump(content | {"material": material}))
    with pytest.raises(InputError) as error:
        read_case(str(path))
    assert said in str(error.value)


def test_reading_a_dataset_imports_nothing(tmp_path: Path) -> None:
    """With a file that would leave a trace; stresses follow from the recorded energy."""
    case, nodal = own_case(tmp_path), tmp_path / "nodal"
    run(read_case(str(case)), nodal, comm=MPI.COMM_SELF)
    assert read_manifest(nodal).case["material"]["model"] == "gel.py:Gel"
    trace = tmp_path / "sprung"
    (tmp_path / "gel.py").write_text(f"open({str(trace)!r}, 'w').close()")
    for words in (
        ["check", str(nodal)],
        ["info", str(nodal)],
        ["structure", str(nodal), "--out", str(tmp_path / "grid")],
        ["export", str(nodal), "--stresses", "--out", str(tmp_path / "series.pvd")],
    ):
        assert main(words) == 0
    assert not trace.exists()


def test_changed_file_is_named(tmp_path: Path) -> None:
    case, nodal = own_case(tmp_path), tmp_path / "nodal"
    run(read_case(str(case)), nodal, comm=MPI.COMM_SELF)
    (tmp_path / "gel.py").write_text((tmp_path / "gel.py").read_text() + "\n# changed\n")
    with pytest.raises(InputError, match=r"the file of material.model = 'gel.py:Gel' has changed"):
        run(read_case(str(case)), nodal, comm=MPI.COMM_SELF)
