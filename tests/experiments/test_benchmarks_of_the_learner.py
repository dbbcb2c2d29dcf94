"""The benchmark of the training loop runs; pages are what the committed results give."""

from __future__ import annotations

import re
from importlib import metadata
from pathlib import Path

import pytest
import torch

from experiments import benchmarks
from experiments.__main__ import main
from experiments.benchmark_commands import PROGRAMS, find_benchmark
from experiments.benchmarks import benchmark, directions, materials, training
from experiments.benchmarks.benchmark import stored_record
from shared_schema import read_manifest
from shared_schema.common import InputError, Parser
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.networks.unet import UNetConfig


def test_both_loops_are_timed(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two batches an epoch, three rounds, of a network of four channels."""
    configuration = training.configuration

    def small(*arguments: object) -> UNetModel:
        network = UNetConfig(levels=2, channels=4)
        return configuration(*arguments).model_copy(update={"network": network})  # type: ignore[arg-type]

    monkeypatch.setattr(training, "configuration", small)
    (result,) = training.compare(
        "paper", "beam2d-det-paper", dataset, torch.device("cpu"), batches=2, rounds=3
    )
    assert len(result["rounds_s"]) == 3
    plain, ours = (sorted(times)[1] for times in zip(*result["rounds_s"], strict=True))
    # 8 samples in the median time, which is rounded to 0.1 ms
    assert result["plain_samples_per_second"] == pytest.approx(8 / plain, rel=0.05)
    assert result["samples_per_second"] == pytest.approx(8 / ours, rel=0.05)
    page = training.page(
        {
            "case": "beam2d",
            "batch": 4,
            "batches": 2,
            "rounds": 3,
            "training": [{**result, "parameters": 1e4, "samples_per_second": 30, "ratio": 1.5}],
        }
    )
    assert "| paper, c = 4 | 0.01 M | float32 | 30 |" in page
    assert "| **1.50** |" in page


def test_directions_are_compared() -> None:
    """Loads that the series predicts to 1e-7: one direction at most, and no wrong claim."""
    found = directions.compare("beam2d_any", 3, seed=1)
    assert found["loads"] == 3
    plain, *driven = found["ways"]
    assert plain["within"] == 1.0
    for way in driven:
        assert way["worst"] <= plain["worst"] < 1e-4
        assert (way["none"] + way["single"], way["claims"], way["wrong"]) == (3, 3, 0)
    assert driven[0]["none"] > 0
    page = directions.page({"seed": 1, "threads": 1, "networks": [found]})
    assert "| `beam2d_any` | 3 | 100.0% |" in page


LEARNERS = {name for name, of in PROGRAMS.items() if of == "surrogate"}


def test_other_materials_are_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Yeoh's rubber in place of the 2D beam's, whose errors are then read; a name that is none."""
    parser = Parser()
    materials.arguments(parser)
    words = ["--loads", "3", "--work", str(tmp_path), "--bodies"]
    options = parser.parse_args([*words, "beam2d_any: yeoh"])
    first = materials.measure(options)
    (row,) = first["bodies"]
    assert row["no_equilibrium"] == row["claimed_wrongly"] == 0
    assert row["within"] == row["claimed"] == 1.0
    assert row["largest"] <= materials.TOLERANCE
    assert "beam2d_any: yeoh | " in materials.page(first)
    monkeypatch.setattr(materials, "compared", None)
    assert materials.measure(options) == first
    with pytest.raises(InputError, match="--bodies 'beam2d_any: steel': expected"):
        materials.measure(parser.parse_args([*words, "beam2d_any: steel"]))


@pytest.mark.parametrize("name", sorted(LEARNERS))
def test_pages_are_made_from_the_records(name: str) -> None:
    benchmark = find_benchmark(name)
    page = benchmark.path.read_text()
    assert page == benchmark.whole_page()
    assert re.search(rf"PyTorch 2\.13\.0\+cpu: `.*python -m experiments benchmark {name}", page)


def test_programs_are_those_of_the_files() -> None:
    files = {path.stem.replace("_", "-") for path in Path(benchmarks.__path__[0]).glob("*.py")}
    no_benchmarks = {"--init--", "benchmark", "corrected-loads", "suspect-loads", "tutorial"}
    assert set(PROGRAMS) == files - no_benchmarks


def test_a_benchmark_is_recorded_and_published(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its record holds options, machine, versions, command and digest; the page is made from it."""
    monkeypatch.setattr(benchmark, "DOCS", tmp_path)
    monkeypatch.setattr(benchmark, "RESULTS", tmp_path / "results")

    def add_options(parser: Parser) -> None:
        parser.add_argument("--count", type=int, default=1)
        parser.add_argument("--data", type=Path, nargs="+")

    made_up = benchmark.Benchmark(
        name="made-up",
        title="Made up",
        measure=lambda options: {"case": "beam2d", "twice": 2 * options.count},
        page=lambda numbers: f"Twice: {numbers['twice']}.\n",
        arguments=add_options,
        variant=lambda options: f"of-{options.count}",
        about="For `{case}`.",
        part="{twice} in all",
    )
    program = "python -m experiments benchmark made-up"
    path = made_up.run(["--count", "3", "--data", str(data)], program)
    assert path == tmp_path / "benchmarks" / "made-up.md"
    assert path.read_text().startswith("# Made up\n\nFor `beam2d`.\n\nTwice: 6.\n\n")
    record = stored_record("made-up-of-3")
    assert record.configuration["count"] == 3
    assert record.command == f"{program} --count 3 --data {data}"
    assert record.datasets[str(data)].digest == read_manifest(data).digest
    assert len(record.machine["load_averages"]) == 2
    assert record.software["torch"] == metadata.version("torch")
    made_up.run(["--count", "1"], program)
    page = path.read_text()  # of both records, each under its heading
    assert re.findall("^(?:## |Twice).*", page, re.M) == [
        "## 2 in all",
        "Twice: 2.",
        "## 6 in all",
        "Twice: 6.",
    ]
    assert page.count("For `beam2d`.") == 1
    file = tmp_path / "results" / "benchmark-made-up-of-3.json"
    file.write_text(file.read_text().replace('"twice": 6', '"twice": 7'))
    with pytest.raises(InputError, match="damaged"):
        stored_record("made-up-of-3")


def test_unknown_benchmark(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["benchmark", "nothing"]) == 2
    assert "benchmark 'nothing': expected one of actuators," in capsys.readouterr().err


def test_list_names_all_experiments(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    lines = [line.split("\t") for line in capsys.readouterr().out.splitlines()]
    counts = {command: sum(line[0] == command for line in lines) for command, _, _ in lines}
    assert counts == {
        "reproduce": 18,
        "beyond": 8,
        "organs": 3,
        "benchmark": len(PROGRAMS),
        "gpu": 19,
    }
    assert ["benchmark", "large-bodies"] in [line[:2] for line in lines]
    assert all(line[2] for line in lines)
