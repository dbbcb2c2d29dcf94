"""The record of several seeds grows, and is refused for other data; README's table beside it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from experiments.benchmark_commands import find_benchmark
from experiments.benchmarks import benchmark
from experiments.benchmarks.benchmark import stored_record
from experiments.benchmarks.seeds import fixed, mean_and_std
from shared_schema.common import InputError
from surrogate.learning.models.unet_model import UNetModel


def test_seeds_are_added_to_the_record(
    data: Path,
    tmp_path: Path,
    make_dataset: Callable[..., Path],
    make_config: Callable[..., UNetModel],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two seeds, then the second again and a third; those of before stay as they were."""
    monkeypatch.setattr(benchmark, "DOCS", tmp_path)
    monkeypatch.setattr(benchmark, "RESULTS", tmp_path / "results")
    config, work = tmp_path / "small.yaml", ["--work", str(tmp_path / "runs")]
    config.write_text(yaml.safe_dump(make_config(epochs=1).plain()))
    of_seeds = find_benchmark("seeds")
    of_seeds.run([str(config), "--data", str(data), "--seeds", "0:2", *work], "seeds")
    first, second = stored_record("seeds-small").findings.numbers["runs"]
    page = of_seeds.run([str(config), "--data", str(data), "--seeds", "1:3", *work], "seeds")
    numbers = stored_record("seeds-small").findings.numbers
    *before, third = numbers["runs"]
    assert before == [first, second]
    assert [run["seed"] for run in numbers["runs"]] == [0, 1, 2]
    errors = [run["test"]["mean_error"] for run in (first, second, third)]
    assert numbers["spread"]["mean_error"]["mean"] == pytest.approx(sum(errors) / 3, rel=1e-5)
    text = page.read_text()
    assert f"| 2 | {fixed(errors[2], numbers['spread']['mean_error'])} | " in text
    assert "| `beam2d`: U-Net | – | – | – | 0.061 | – | 0.3 |" in text
    other = make_dataset(tmp_path / "other", seed=1)
    with pytest.raises(InputError, match="its record is of another configuration or dataset"):
        of_seeds.run([str(config), "--data", str(other), *work], "seeds")


def test_digits_are_those_of_the_standard_deviation() -> None:
    """To its second digit, in 10⁻³ m: 0.0606 ± 0.0052 of 6.0567e-5 m and 5.22e-6 m."""
    of = {"mean": 6.0567e-5, "std": 5.22e-6, "min": 5.6e-5, "max": 6.6e-5}
    assert mean_and_std(of) == "0.0606 ± 0.0052"
    assert fixed(of["max"], of) == "0.0660"
    assert mean_and_std({"mean": 0.00156, "std": None}) == "1.6"
    assert mean_and_std({"mean": 0.3, "std": 0.02}) == "300 ± 20"
