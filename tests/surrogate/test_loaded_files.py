"""How many files of the project the two commands load that most people use."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import yaml

from surrogate.learning.models.unet_model import UNetModel
from tests.end_to_end.commands import ROOT

COUNT = """
import sys
from surrogate.command_line import main

assert main(sys.argv[1:]) == 0
files = {
    module.__file__
    for name, module in sys.modules.copy().items()
    if name.partition(".")[0] in ("surrogate", "shared_schema")
}
rooms = {".".join(name.split(".")[1:3]) for name in sys.modules if name.startswith("surrogate.")}
print(len(files), *sorted(rooms))
"""
MOST_FOR_A_PREDICTION, MOST_FOR_A_TRAINING = 149, 157


def loaded(*arguments: object) -> tuple[int, set[str]]:
    """Number of files, and rooms in them, that a command loads."""
    command = [sys.executable, "-c", COUNT, *map(str, arguments)]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    count, *rooms = result.stdout.splitlines()[-1].split()
    return int(count), set(rooms)


def test_a_prediction(tmp_path: Path) -> None:
    load = ("--load", "4,1:0,-1.5")
    count, rooms = loaded("predict", "beam2d_any", *load, "--out", tmp_path / "u.npz")
    assert count <= MOST_FOR_A_PREDICTION
    assert "learning.inference" in rooms
    assert not [room for room in rooms if room.startswith(("contrib", "figures", "page"))]
    assert not rooms & {"learning.training", "mechanics.touch", "mechanics.identification"}


def test_a_training(tmp_path: Path, data: Path, make_config: Callable[..., UNetModel]) -> None:
    config = tmp_path / "small.yaml"
    config.write_text(yaml.safe_dump(make_config(epochs=1).plain()))
    count, rooms = loaded("train", config, "--data", data, "--out", tmp_path / "run")
    assert count <= MOST_FOR_A_TRAINING
    assert "learning.training" in rooms
    assert not [room for room in rooms if room.startswith(("contrib", "figures", "page"))]
