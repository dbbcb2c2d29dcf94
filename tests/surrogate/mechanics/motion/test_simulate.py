"""surrogate simulate: files, scripts, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import surrogate
from surrogate.command_line import main
from surrogate.mechanics.motion.simulation import Script

BEAM = ["simulate", "beam2d_any", "--density", "1"]
TIMED = ["--duration", "0.1", "--step", "0.02"]
SCRIPT = """
step: 0.02
phases:
  - {seconds: 0.04, load: ["4,1:0,-0.1"], tool: "sphere:3,1.32:0.3"}
  - {seconds: 0.04, load: ["4,1:0,-0.3"], tool: "sphere:3,1.28:0.3", moving: true}
  - {seconds: 0.02, held: ["4,0:0,-"]}
"""


def test_let_go(tmp_path: Path) -> None:
    """From equilibrium under the load, and then none."""
    out = tmp_path / "motion.npz"
    load = ["--load", "4,1:0,-0.5", "--history", "let_go"]
    assert main([*BEAM, *TIMED, *load, "--out", str(out)]) == 0
    found = np.load(out)
    np.testing.assert_allclose(found["times"], 0.02 * np.arange(1, 6))
    session = surrogate.Session(surrogate.load("beam2d_any"), density=1.0)
    session.begin("4,1:0,-0.5")
    for displacement in found["displacement"]:
        np.testing.assert_allclose(session.step(0.02).displacement, displacement)
    assert found["energies"].shape == (5, 5)


def test_script(tmp_path: Path) -> None:
    """Numbers of a moving phase go from those of the phase before."""
    path, out = tmp_path / "script.yaml", tmp_path / "motion.pvd"
    path.write_text(SCRIPT)
    now = Script.read(path).phases
    half = now[1].on_the_way(now[0], 0.5)
    assert half.load == ("4.0,1.0:0.0,-0.2",)
    assert half.tool == "sphere:3.0,1.3:0.3"
    assert main([*BEAM, "--script", str(path), "--out", str(out)]) == 0
    assert len(list(tmp_path.glob("motion-*.vtu"))) == 5


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([*BEAM[:2], *TIMED], "density"),
        ([*BEAM, "--step", "0.02"], "expected either --duration and --step, or --script"),
        ([*BEAM, *TIMED, "--history", "shaken"], "--history 'shaken': expected held"),
        ([*BEAM, *TIMED, "--load", "9,9:0,1"], "9,9"),
        ([*BEAM, "--script", "wrong.yaml"], "moving: '4,0:0,1'"),
    ],
)
def test_refused(
    arguments: list[str],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Exit code 2, one line, and no file."""
    monkeypatch.chdir(tmp_path)
    wrong = "step: 0.1\nphases: [{seconds: 1, load: ['4,0:0,1'], moving: true}]\n"
    Path("wrong.yaml").write_text(wrong)
    assert main([*arguments, "--out", "motion.npz"]) == 2
    assert said in capsys.readouterr().err.strip().splitlines()[-1]
    assert not Path("motion.npz").exists()
