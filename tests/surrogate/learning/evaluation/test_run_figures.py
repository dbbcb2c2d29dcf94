"""The figures in the folder of an evaluated run."""

from __future__ import annotations

from pathlib import Path


def test_figures_of_a_deterministic_network(evaluated: Path) -> None:
    names = sorted(path.name for path in (evaluated / "figures").iterdir())
    assert names == [
        "deformed.png",
        "error_field.png",
        "errors.png",
        "loss.png",
        "von_mises.png",
    ]
