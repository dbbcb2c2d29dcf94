"""Training by the potential energy, on the body of the made-up dataset."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from shared_schema.common.errors import InputError
from surrogate.command_line import main
from surrogate.data.random_loads import random_loads
from surrogate.inference.prediction import load
from surrogate.runs.description import Refinement
from surrogate.runs.folder import RunFolder
from surrogate.training.refine import Descent, refine

REFINEMENT = Refinement(family="trained", steps=60, learning_rate=2e-3)
CPU = torch.device("cpu")


def test_gradient_of_the_potential_energy(trained: Path) -> None:
    """Along K(0)⁻¹ r, Π grows by r · K(0)⁻¹ r: a central difference of Π itself."""
    surrogate = load(trained)
    data, equilibrium = surrogate.description.data, surrogate.equilibrium
    family = random_loads("trained", surrogate.geometry, data.info.force.max_abs, data.load_numbers)
    forces = family.draw(3, np.random.default_rng(0))
    u = equilibrium.linear_response(0.9 * forces)
    slope, sizes = Descent(equilibrium, family, REFINEMENT).direction(u, forces)
    linear = equilibrium.linear_response(forces)
    step = 1e-3 * np.abs(u).max()
    change = equilibrium.potential(u + step * slope, forces)
    change = (change - equilibrium.potential(u - step * slope, forces)) / (2 * step)
    work = (forces * linear).sum((1, 2))
    length = np.sqrt(np.square(linear).sum((1, 2)))
    np.testing.assert_allclose(change, sizes**2 * work / length, rtol=1e-4)


def test_inverted_load_cases_are_left_out(trained: Path) -> None:
    surrogate = load(trained)
    data = surrogate.description.data
    family = random_loads("trained", surrogate.geometry, data.info.force.max_abs, data.load_numbers)
    forces = family.draw(2, np.random.default_rng(0))
    u = np.zeros_like(forces)
    u[0, -1, 0] = -9.0
    slope, sizes = Descent(surrogate.equilibrium, family, REFINEMENT).direction(u, forces)
    assert not slope[0].any()
    assert sizes == pytest.approx([0.0, 1.0])  # at rest r = −f


def test_refined_run_is_nearer_to_equilibrium(trained: Path, tmp_path: Path) -> None:
    """The made-up displacements are no equilibria, so that there is much to gain."""
    out = RunFolder(tmp_path / "refined")
    refine(trained, out, REFINEMENT, CPU)
    before, after = load(trained), load(out.folder)
    assert after.description.refined == REFINEMENT
    assert after.description.run == before.description.run
    assert [line["epoch"] for line in out.metric_lines()] == [1]
    data = before.description.data
    family = random_loads("trained", before.geometry, data.info.force.max_abs, data.load_numbers)
    forces = family.draw(50, np.random.default_rng(9))

    def error(model: object) -> float:
        found = model.certify(forces)  # type: ignore[attr-defined]
        return float(np.median(found.relative_error))

    assert error(after) < 0.75 * error(before)
    again = RunFolder(tmp_path / "again")
    refine(trained, again, REFINEMENT, CPU)
    for name, tensor in out.read_tensors().items():
        assert torch.equal(tensor, again.read_tensors()[name]), name


def test_command(trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "refined"
    command = ["refine", str(trained), "--steps", "2", "--family", "loads=1-2", "--out", str(out)]
    assert main(command) == 0
    assert f"{out}: 2 steps, forces out of balance by" in capsys.readouterr().out
    assert main(command) == 2
    assert "refined already" in capsys.readouterr().err
    assert main([*command[:-1], str(tmp_path / "other"), "--family", "loads=0"]) == 2
    assert "--family 'loads=0'" in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


def test_networks_that_predict_standard_deviations(
    make_run: Callable[..., Path], tmp_path: Path
) -> None:
    run = make_run(likelihood="maximum_likelihood", epochs=1)
    with pytest.raises(InputError, match="expected a deterministic network"):
        refine(run, RunFolder(tmp_path / "refined"), REFINEMENT, CPU)
