"""The public names of the package, imported at their first use."""

from __future__ import annotations

import subprocess
import sys

import pytest

import surrogate
from tests.end_to_end.commands import ROOT


def test_every_name_is_there() -> None:
    for name in surrogate.__all__:
        assert getattr(surrogate, name).__doc__
        assert name in dir(surrogate)
    with pytest.raises(AttributeError, match="module 'surrogate' has no attribute 'fly'"):
        surrogate.fly  # noqa: B018


def test_a_prediction_loads_neither_training_nor_figures() -> None:
    code = (
        "import sys, surrogate\n"
        "surrogate.load('beam2d_any').averaged_passes([[0.0, 0.0]] * 64)\n"
        "print(*sorted(name for name in sys.modules if name.startswith('surrogate.')))\n"
    )
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    modules = [name.split(".")[1:] for name in result.stdout.split()]
    rooms = {".".join(parts[:2]) for parts in modules}
    assert "learning.inference" in rooms
    assert not rooms & {"learning.training", "learning.evaluation", "learning.measures"}
    assert not {parts[0] for parts in modules} & {"figures", "page", "commands", "contrib"}
    certify = {parts[2] for parts in modules if parts[1:2] == ["certify"] and len(parts) == 3}
    assert certify <= {"certificate_protocol"}  # its type alone
    assert "mechanics.touch" not in rooms
    assert "mechanics.identification" not in rooms
