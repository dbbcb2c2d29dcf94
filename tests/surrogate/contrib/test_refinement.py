"""Training by the potential energy, on the body of the made-up dataset."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from shared_schema.common.errors import InputError
from surrogate.command_line import main
from surrogate.contrib.refinement import Descent, refine
from surrogate.learning.data.load_families import random_loads
from surrogate.learning.inference.loading import load
from surrogate.learning.runs.description import Refinement
from surrogate.learning.runs.folder import RunFolder

REFINEMENT = Refinement(family="trained", steps=60, learning_rate=1e-3)
OPTIONS: dict[str, Any] = {"steps": 60, "learning_rate": 1e-3, "device": "cpu"}


@pytest.fixture
def descent(trained: Path) -> Descent:
    surrogate = load(trained)
    data = surrogate.description.data
    family = random_loads("trained", surrogate.geometry, data.info.force.max_abs, data.load_numbers)
    return Descent(surrogate.body.equilibrium, family, REFINEMENT)


def test_gradient_of_the_potential_energy(descent: Descent) -> None:
    """A central difference along random fields; Π is 0 at rest, and −1/2 if linear."""
    random = np.random.default_rng(0)
    forces = descent.family.draw(3, random)
    u = 0.9 * descent.equilibrium.linear_response(forces)
    v = random.normal(size=u.shape) * descent.equilibrium.free
    gradient, _ = descent.gradient(u, forces)
    step = 1e-6
    ahead, behind = (descent.gradient(u + sign * step * v, forces)[1] for sign in (1, -1))
    np.testing.assert_allclose((ahead - behind) / (2 * step), (gradient * v).sum((1, 2)), rtol=1e-5)
    _, at_rest = descent.gradient(0 * u, forces)
    np.testing.assert_array_equal(at_rest, 0.0)
    small = 1e-4 * forces
    _, linear = descent.gradient(descent.equilibrium.linear_response(small), small)
    np.testing.assert_allclose(linear, -0.5, rtol=1e-3)


def test_inverted_load_cases_are_left_out(descent: Descent) -> None:
    forces = descent.family.draw(2, np.random.default_rng(0))
    u = np.zeros_like(forces)
    u[0, -1, 0] = -9.0
    gradient, values = descent.gradient(u, forces)
    assert not gradient[0].any()
    assert gradient[1].any()
    assert values.tolist() == [np.inf, 0.0]


def test_refined_run_has_less_energy(descent: Descent, trained: Path, tmp_path: Path) -> None:
    """The made-up displacements are no equilibria, so that there is much to gain."""
    out = RunFolder(tmp_path / "refined")
    refine(trained, out.folder, **OPTIONS)
    before, after = load(trained), load(out.folder)
    assert after.description.refined == REFINEMENT
    assert after.description.run == before.description.run
    assert [line["epoch"] for line in out.metric_lines()] == [1]
    forces = descent.family.draw(50, np.random.default_rng(9))
    energy = [descent.gradient(model.predict(forces), forces)[1] for model in (before, after)]
    assert np.median(energy[1]) < np.median(energy[0]) - 0.1
    again = RunFolder(tmp_path / "again")
    refine(trained, again.folder, **OPTIONS)
    for name, tensor in out.read_tensors().items():
        assert torch.equal(tensor, again.read_tensors()[name]), name


def test_command(trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "refined"
    command = ["refine", str(trained), "--steps", "2", "--family", "loads=1-2", "--out", str(out)]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert f"{out}: 2 steps, potential energy " in said
    files = {path: path.read_bytes() for path in out.iterdir() if path.is_file()}
    assert main(command) == 0  # as after a kill at the very end
    assert capsys.readouterr().out == said
    assert {path: path.read_bytes() for path in out.iterdir() if path.is_file()} == files
    assert main([*command, "--seed", "1"]) == 2
    assert "a run with another" in capsys.readouterr().err
    assert main([*command[:-1], str(tmp_path / "other"), "--family", "loads=0"]) == 2
    assert "--family 'loads=0'" in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


def test_a_killed_command_goes_on(
    trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The measures of its epochs are written, the weights are not yet."""
    whole, out = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "refined")
    refine(trained, whole.folder, **OPTIONS)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as killed:
        killed.setattr(RunFolder, "write_model", stop)
        with pytest.raises(KeyboardInterrupt):
            refine(trained, out.folder, **OPTIONS)
    assert out.metrics.is_file()
    assert not out.is_finished
    refine(trained, out.folder, **OPTIONS)
    assert len(out.metric_lines()) == len(whole.metric_lines())
    for name, tensor in whole.read_tensors().items():
        assert torch.equal(tensor, out.read_tensors()[name]), name


def test_networks_that_predict_standard_deviations(
    make_run: Callable[..., Path], tmp_path: Path
) -> None:
    run = make_run(likelihood="maximum_likelihood", epochs=1)
    with pytest.raises(InputError, match="expected a deterministic network"):
        refine(run, tmp_path / "refined", **OPTIONS)
