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
        "names = ' '.join(name for name in sys.modules if name.startswith('surrogate.'))\n"
        "print(*set(names.replace('.', ' ').split()))\n"
    )
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    rooms = set(result.stdout.split())
    assert "inference" in rooms
    assert not rooms & {"training", "evaluation", "figures", "page", "commands"}
    assert not rooms & {"full_certificate", "fast_certificate", "correction"}
