"""The benchmark of the training loop runs; pages are what the committed results give."""

from __future__ import annotations

import json
from types import ModuleType

import pytest
import torch

from experiments.benchmarks import (
    load_series,
    prediction_latency,
    trained_latency,
    training_throughput,
)
from experiments.benchmarks.publication import machine, page_path, result_path
from surrogate.data.dataset import Dataset
from surrogate.models.unet_model import UNetModel
from surrogate.networks.unet import UNetConfig


def test_both_loops_are_timed(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two batches an epoch, three rounds, of a network of four channels."""
    configuration = training_throughput.configuration

    def small(*arguments: object) -> UNetModel:
        network = UNetConfig(levels=2, channels=4)
        return configuration(*arguments).model_copy(update={"network": network})  # type: ignore[arg-type]

    monkeypatch.setattr(training_throughput, "configuration", small)
    (result,) = training_throughput.compare(
        "paper", "beam2d-det-paper", dataset, torch.device("cpu"), batches=2, rounds=3
    )
    assert len(result["rounds_s"]) == 3
    plain, ours = (sorted(times)[1] for times in zip(*result["rounds_s"], strict=True))
    # 8 samples in the median time, which is rounded to 0.1 ms
    assert result["plain_samples_per_second"] == pytest.approx(8 / plain, rel=0.05)
    assert result["samples_per_second"] == pytest.approx(8 / ours, rel=0.05)
    described = machine(lambda: {"torch": "2.13"})
    described["load_averages"] *= 2
    page = training_throughput.table(
        {
            "command": "a",
            "machine": described,
            "case": "beam2d",
            "batch": 4,
            "batches": 2,
            "rounds": 3,
            "training": [{**result, "parameters": 1e4, "samples_per_second": 30, "ratio": 1.5}],
        }
    )
    assert "| paper, c = 4 | 0.01 M | float32 | 30 |" in page
    assert "| **1.50** |" in page
    assert "PyTorch 2.13. Made by" in page


@pytest.mark.parametrize(
    ("name", "benchmark"),
    [
        ("load-series", load_series),
        ("training", training_throughput),
        ("prediction", prediction_latency),
        ("trained", trained_latency),
    ],
)
def test_pages_are_made_from_the_results(name: str, benchmark: ModuleType) -> None:
    results = json.loads(result_path(name).read_text())
    assert page_path(name).read_text() == benchmark.table(results)
    assert f"python -m {benchmark.__name__}" in results["command"]
