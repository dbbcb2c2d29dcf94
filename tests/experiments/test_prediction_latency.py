"""Inputs of the benchmark of prediction times, on a small body."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.benchmarks import prediction
from experiments.benchmarks.prediction import latencies, page
from experiments.measures.untrained import read_body, shape_of, untrained

WAYS = {"PyTorch_ms": 1.234, "drawing_ms": None, "compiled_ms": 0.5, "ONNX_ms": 0.0625}


def test_body_of_a_dataset(data: Path) -> None:
    """Every sample of the synthetic dataset states 0.5 s; one node is loaded."""
    body = read_body(data.parent / "nodal")
    assert body.solving_ms == 500
    assert body.force.shape == (1, 32, 2)
    assert np.count_nonzero(body.force.any(axis=2)) == 1
    assert body.geometry.grid.shape == (8, 4)


def test_shapes() -> None:
    """The paper has 3 levels in 2D, 4 in 3D and 128 channels; ours has 32 and no padding."""
    assert [shape_of("paper", d).levels for d in (2, 3)] == [3, 4]
    assert shape_of("paper", 3).channels == 128
    assert (shape_of("fast", 2).channels, shape_of("fast", 2).padding) == (32, 0)


@pytest.mark.slow
def test_every_way_is_timed(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prediction, "PASSES", 2)
    body = read_body(data.parent / "nodal")
    run = untrained(body, "fast", "variational_bayes", tmp_path / "run")
    found = latencies(body, run, "cpu", ("PyTorch", "ONNX"), repeats=2)
    assert found["passes"] == 2
    assert found["parameters"] == 950_596
    assert min(found[f"{name}_ms"] for name in ("PyTorch", "drawing", "ONNX")) > 0
    assert "compiled_ms" not in found


def test_table() -> None:
    latency: dict[str, Any] = {
        **{"case": "beam2d", "recipe": "fast", "passes": 1, "parameters": 471_298},
        **{"device": "cpu", **WAYS},
    }
    text = page(
        {
            "onnxruntime": "1.31",
            "solving_ms": {"beam2d": 1.02, "block3d": 7.0},
            "latencies": [latency],
        }
    )
    assert "| `beam2d` | fast | 1 | 0.471 M | cpu | 1.23 | 0.5 | 0.0625 |  |\n" in text
    assert "| `beam2d` | 1.02 | 123 | 5 | 1 |\n" in text
    assert "| `block3d` | 7 |  |  |  |\n" in text
