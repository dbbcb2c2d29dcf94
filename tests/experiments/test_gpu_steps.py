"""The command for a machine with a GPU: its steps, what it goes on with, and the carried data."""

from __future__ import annotations

import argparse
import math
import re
import subprocess
import sys
import tarfile
import time
import tomllib
from collections.abc import Callable, Sequence
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
import torch

from experiments import gpu_commands
from experiments.__main__ import main
from experiments.framework.experiment import Findings
from experiments.framework.machine import ROOT
from experiments.framework.record import Record, read_record, write_record
from experiments.framework.runner import run
from experiments.gpu import archive
from experiments.gpu.carried_dataset import pack, rounded_differences, summed, unpack
from experiments.gpu.catalogue import STEPS, Step
from experiments.gpu.recipes import paper_recipe
from experiments.gpu.setting import GpuSetting
from experiments.measures.untrained import shape_of
from shared_schema.checker import check_dataset
from shared_schema.common import make_parser
from surrogate.learning.data.joined_dataset import read_dataset

CPU = torch.device("cpu")
IMPORTED = {"pyyaml": "yaml", "scikit-learn": "sklearn"}
OF_TORCH = ("filelock", "sympy")  # which PyTorch brings with it
THERE = (
    "torch",
    *OF_TORCH,
    "numpy",
    "scipy",
    "numba",
    "sklearn",
    "matplotlib",
    "pytest",
)  # docs/gpu.md


@pytest.fixture(scope="module")
def datasets(make_dataset: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Datasets of all cases and two runs, packed."""
    folder = tmp_path_factory.mktemp("gpu")
    for case, dimension in {"beam2d": 2, "lshape2d": 2, "beam3d": 3}.items():
        make_dataset(folder / "data" / case, dimension, name=case)
    packing = [str(folder / "packed"), "--data", str(folder / "data"), "--no-wheels"]
    packing += ["--runs", "beam2d_any", "beam3d_any_reduced"]
    assert main(["gpu", "pack", *packing]) == 0
    return folder / "packed" / "data"


@pytest.fixture
def setting(datasets: Path, tmp_path: Path) -> GpuSetting:
    return GpuSetting(tmp_path, datasets, CPU, True, time.monotonic() + 1000)


@pytest.fixture
def _clock_stands_still(monkeypatch: pytest.MonkeyPatch) -> None:
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now)


def record_of(out: Path, name: str) -> Record:
    record = read_record(out / f"{name}.json")
    assert record is not None
    return record


def test_shapes() -> None:
    """The paper has 3 levels in 2D, 4 in 3D and 128 channels; ours has 32 and no padding."""
    assert [shape_of("paper", d).levels for d in (2, 3)] == [3, 4]
    assert shape_of("paper", 3).channels == 128
    assert (shape_of("fast", 2).channels, shape_of("fast", 2).padding) == (32, 0)


def test_differences_by_hand() -> None:
    """u = 10, 11 | 12, 14 in steps of 1: along y 10, 1 | 12, 2, and then along x 10, 1 | 2, 1."""
    field = np.array([[[[10.2, 11.0], [12.0, 13.8]]]], dtype=np.float32)
    differences = rounded_differences(field, 1.0)
    assert differences.tolist() == [[[[10, 1], [2, 1]]]]
    assert summed(differences, 1.0).tolist() == [[[[10, 11], [12, 14]]]]


def test_carried_dataset_is_the_same_to_half_a_step(data_3d: Path, tmp_path: Path) -> None:
    """Float32 adds 6e-8 of 1 m at most to half of the step of 1e-4 m."""
    path, folder = tmp_path / "a.npz.xz", tmp_path / "a"
    assert pack(data_3d, path, samples=50, step=1e-4) == 50
    unpack(path, folder)
    assert check_dataset(folder) == []
    source, carried = read_dataset(data_3d), read_dataset(folder)
    assert len(carried.train) + len(carried.test) == 50
    for one, other in ((carried.train, source.train), (carried.test, source.test)):
        assert torch.equal(one.force, other.force[: len(one)])
        difference = (one.displacement - other.displacement[: len(one)]).abs().max()
        assert 1e-5 < difference < 0.5e-4 + 6e-8
    assert torch.equal(
        torch.from_numpy(carried.geometry.coordinates),
        torch.from_numpy(source.geometry.coordinates),
    )
    assert carried.info.force == source.info.force


def test_steps_need_no_other_packages_than_those_that_are_there() -> None:
    """Steps, and loading a network, with all other declared packages missing."""
    named = re.findall(r"[a-z0-9]+", (ROOT / "experiments/gpu/requirements.txt").read_text())
    there = {*THERE, *(IMPORTED.get(name, name) for name in named)}
    declared: set[str] = set()
    for package in ("shared_schema", "surrogate"):
        project = tomllib.loads((ROOT / package / "pyproject.toml").read_text())["project"]
        extras = project.get("optional-dependencies", {}).values()
        for line in (*project["dependencies"], *(line for extra in extras for line in extra)):
            name = re.match(r"[A-Za-z0-9-]+", line)
            assert name is not None
            declared.add(IMPORTED.get(name[0], name[0]))
    missing = sorted(declared - there - {"solid-schema"})
    assert "meshio" in missing
    program = (
        f"import sys; sys.modules.update(dict.fromkeys({missing}))\n"
        "import experiments.gpu.catalogue, surrogate; surrogate.load('beam2d_any')"
    )
    subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=True)


def test_what_is_done_is_not_done_again(setting: GpuSetting) -> None:
    """A step that fails leaves its traceback; one that is not finished goes on in the next call."""
    calls: list[str] = []

    def step(name: str, *outcomes: Findings) -> Step:
        following = iter(outcomes)

        def work(_: GpuSetting) -> Findings:
            calls.append(name)
            return next(following)

        return Step(name, name, "", work, seconds=100)

    first, second = Findings(numbers={"x": 1}, finished=False), Findings(numbers={"x": 3})
    steps = [step("a", Findings(numbers={"x": 1})), step("b"), step("c", first, second)]
    following: list[str] = []

    def after_error(rest: Sequence[Step]) -> None:
        following.extend(step.name for step in rest)

    outcome = run(steps, setting, setting.out, after_error=after_error)
    assert (outcome.unfinished, outcome.failed, following) == (["c"], ["b"], ["c"])
    assert "StopIteration" in record_of(setting.out, "b").error
    assert run(steps, setting, setting.out, after_error=after_error).unfinished == []
    assert calls == ["a", "b", "c", "c"]
    assert record_of(setting.out, "c").findings.numbers == {"x": 3}
    described = record_of(setting.out, "a")
    assert described.finished
    assert described.software["torch"] == metadata.version("torch")
    assert described.configuration == {"small": True}


@pytest.mark.usefixtures("_clock_stands_still")
def test_after_an_error_on_a_gpu_a_new_process_goes_on(
    setting: GpuSetting, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[list[str]] = []
    monkeypatch.setattr("os.execv", lambda _, words: started.append(words))
    call = ["gpu", "run", str(setting.out), "--data", "d", "--total", "100", "--small"]
    rest = [Step("c", "c", "", lambda _: Findings())]
    for device, again in (("cpu", []), ("cuda", []), ("cuda", ["--step", "b", "--step", "c"])):
        options = parsed([*call, "--device", device, *again])
        given = setting.until(time.monotonic() + 60)
        given.device = torch.device(device)
        gpu_commands.start_afresh(options, given, [])
        gpu_commands.start_afresh(options, given, rest)
    assert len(started) == 2
    assert all(words[1:3] == ["-m", "experiments"] for words in started)
    later = [parsed(words[3:]) for words in started]
    assert [options.total for options in later] == pytest.approx([60, 60])
    assert [options.step for options in later] == [None, ["c"]]
    assert all(options.small and options.device == "cuda" for options in later)


def parsed(arguments: list[str]) -> argparse.Namespace:
    parser, commands = make_parser("experiments", "", "0")
    gpu_commands.add_to(commands)
    return parser.parse_args(arguments)


@pytest.mark.usefixtures("_clock_stands_still")
def test_a_step_gets_what_is_left_of_its_time(setting: GpuSetting) -> None:
    """Of 100 s in all, the call has 50; a step that has spent its time is finished as it is."""
    left: list[float] = []

    def work(given: GpuSetting) -> Findings:
        left.append(given.seconds_left)
        return Findings(finished=False)

    step = Step("a", "a", "", work, seconds=100)
    short = setting.until(time.monotonic() + 50)
    assert run([step], short, setting.out).unfinished == ["a"]
    spent = record_of(setting.out, "a").model_copy(update={"seconds": 95.0})
    write_record(spent, setting.out / "a.json")
    assert run([step], setting, setting.out).unfinished == []
    assert left == pytest.approx([50, 5])
    late = setting.until(time.monotonic() + 10)
    assert run([Step("b", "b", "", work)], late, setting.out).unfinished == ["b"]
    assert not (setting.out / "b.json").exists()


def test_a_training_goes_on_where_the_call_before_stopped(setting: GpuSetting) -> None:
    """Without time, one of the two epochs is trained and its network evaluated."""
    work = paper_recipe("lshape2d-det-paper")
    first, second = work(setting.until(time.monotonic())), work(setting)
    assert [first.numbers["epochs"], first.finished] == [1, False]
    assert [second.numbers["epochs"], second.finished] == [2, True]
    assert first.numbers["test"]["mean_error"] > 0
    assert second.numbers["curve"][0] == first.numbers["curve"][0]
    elsewhere = GpuSetting(setting.out / "whole", setting.data, CPU, True, setting.deadline)
    assert work(elsewhere).numbers["test"] == second.numbers["test"]


def test_archive_has_results_and_parts_of_weights(
    setting: GpuSetting, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = setting.out / "runs" / "a"
    run.mkdir(parents=True)
    for name in ("metrics.jsonl", "model.safetensors"):
        (run / name).write_bytes(b"0123456789")
    monkeypatch.setattr(archive, "LIMIT", 4)
    parts = archive.split(setting.out, setting.out, "a")
    assert b"".join(part.read_bytes() for part in parts) == b"0123456789"
    assert [part.name[-3:] for part in parts] == [".00", ".01", ".02"]
    monkeypatch.undo()
    (path,) = archive.archive(setting.out, setting.out / "sent", [])
    with tarfile.open(path) as tar:
        assert "runs/a/metrics.jsonl" in tar.getnames()
        assert not any(name.endswith(".safetensors") for name in tar.getnames())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--step", "nothing"], "'nothing': expected one of gpu-tests"),
        (["--total", "0"], "--total 0.0: expected more than 0"),
        (["--data", "nowhere"], "--data 'nowhere': no dataset of 'beam2d' in it"),
    ],
)
def test_wrong_options(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["gpu", "run", str(out), "--device", "cpu", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()


def test_the_committed_page_is_that_of_the_committed_records(tmp_path: Path) -> None:
    records, page = ROOT / "docs" / "results" / "gpu", tmp_path / "page.md"
    assert main(["gpu", "report", str(records), str(page)]) == 0
    assert page.read_text() == (ROOT / "docs" / "gpu-results.md").read_text()
    assert main(["gpu", "report", str(tmp_path), str(page)]) == 2


@pytest.mark.slow
def test_rehearsal_on_the_cpu(
    datasets: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All steps run with small networks; a second call has nothing to do."""
    options = ["--device", "cpu", "--small", "--seconds", "500"]
    call = ["gpu", "run", str(tmp_path), "--data", str(datasets), *options]
    assert main(call) == 0
    assert "all steps are done" in capsys.readouterr().out
    records = {step.name: record_of(tmp_path, step.name) for step in STEPS}
    assert all(record.finished and not record.error for record in records.values())
    results = {name: record.findings.numbers for name, record in records.items()}
    timed = ("latency", "throughput", "responses", "frames")
    assert all(results[name]["complete"] for name in timed)
    assert [run["nodes"] for run in results["frames"]["frames"]] == [64, 4032]
    for found in [*results["responses"]["responses"], *results["frames"]["frames"]]:
        assert found["relative_difference"] < 1e-5
    assert results["gpu-tests"]["failed"] == []
    cases = [found["case"] for found in results["latency"]["latencies"]]
    assert set(cases) == {"beam2d", "lshape2d", "beam3d"}
    for found in results["latency"]["latencies"]:
        assert found["relative_difference"] == 0  # on a CPU
    assert {found["network"] for found in results["throughput"]["training"]} == {
        "paper",
        "fast",
        "3D, c = 64",
    }
    for name, result in results.items():
        if name.startswith(("last-axis", "paper", "without", "beam3d")):
            assert math.isfinite(result["test"]["mean_error"])
            assert result["epochs"] == 2
    assert main(call) == 0
    assert "latency (2 of 19): up to date" in capsys.readouterr().err
