"""Every command: 0 and a line on stdout, or 2, a line on stderr and nothing written."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml

import surrogate
from surrogate.command_line import main
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.optim.optimisers import ScheduleConfig

AT_ONCE = ("--budget", "1e-12")  # no time for a direction


@pytest.fixture
def config(tmp_path: Path, make_config: Callable[..., UNetModel]) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(yaml.safe_dump(make_config(epochs=2).plain()))
    return path


@pytest.fixture
def out(tmp_path: Path) -> Path:
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


def assert_refused(
    arguments: Sequence[object], part: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(out.rglob("*"))
    capsys.readouterr()
    assert main([str(a) for a in arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert captured.err.startswith("surrogate: error: ")
    assert part in captured.err
    assert "Traceback" not in captured.err
    assert sorted(out.rglob("*")) == before


def test_train_stop_and_go_on(
    config: Path, data: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["train", str(config), "--data", str(data), "--out", str(out / "run")]
    assert main([*command, "--device", "cpu", "--stop-after", "1"]) == 0
    assert "stopped; resume with the same command, 1 of 2 epochs" in capsys.readouterr().out
    assert not (out / "run" / "model.safetensors").exists()
    assert main([*command, "--device", "cpu"]) == 0
    assert "trained, 2 of 2 epochs" in capsys.readouterr().out
    assert (out / "run" / "model.safetensors").is_file()


def test_changed_keys_are_those_of_the_run(
    config: Path, data: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = out / "run"
    command = ["train", str(config), "--data", str(data), "--out", str(run), "--device", "cpu"]
    wrong = [*command, "--set", "training.epochs=none"]
    assert_refused(wrong, f"{config} --set training.epochs=none: key", out, capsys)
    assert_refused([*command, "--set", "training.epoch=1"], "unknown key", out, capsys)
    changes = ["--set", "training.epochs=1", "--set", "training.schedule={name: linear}"]
    assert main([*command, *changes]) == 0
    kept = yaml.safe_load((run / "config.yaml").read_text())["run"]
    assert kept["training"]["epochs"] == 1
    assert kept["training"]["schedule"]["name"] == "linear"
    assert kept["recipe"] == "custom"


@pytest.mark.slow
def test_evaluate_and_report(
    trained: Path, data: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = out / "run"
    shutil.copytree(trained, run)
    assert main(["evaluate", str(run), "--data", str(data), "--device", "cpu"]) == 0
    assert "12 test samples, mean error" in capsys.readouterr().out
    nodal, page = data.parent / "nodal", out / "report.html"
    assert main(["report", str(run), "--nodal", str(nodal), "--out", str(page)]) == 0
    assert capsys.readouterr().out == f"{page}\n"
    assert page.is_file()


@pytest.mark.parametrize("suffix", [".npz", ".vtu", ".xdmf"])
def test_predict(trained: Path, out: Path, suffix: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = out / f"u{suffix}"
    loads = ["--load", "3.5,1.5:0.5,-1", "--load", "2,1.5:0,1"]
    assert main(["predict", str(trained), *loads, "--out", str(path)]) == 3  # made-up data
    captured = capsys.readouterr()
    warning = "surrogate: warning: number of loaded nodes 2, 1 in the training data\n"
    assert captured.err.startswith(f"{warning}surrogate: not certified: the forces are out of ")
    assert captured.out.startswith(f"{path}: largest displacement ")
    assert " m; predicted, estimated error " in captured.out
    assert captured.out.endswith(" by one direction, not certified\n")
    if suffix == ".npz":
        with np.load(path) as found:
            # spacing 0.5: (3.5, 1.5) is grid point (7, 3), node 31; (2, 1.5) is (4, 3), node 19
            expected = np.zeros((32, 2))
            expected[31], expected[19] = (0.5, -1), (0, 1)
            np.testing.assert_array_equal(found["force"], expected)
            predicted = surrogate.load(trained).averaged_passes(expected).mean
            np.testing.assert_array_equal(found["displacement"], predicted)


def test_predict_with_standard_deviations(
    trained_bayes: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    load, path = ["--load", "3.5,1.5:0.5,-1"], out / "u.npz"
    passes = ["--passes", "7", "--seed", "2", "--device", "cpu"]
    assert main(["predict", str(trained_bayes), *load, *passes, "--out", str(path)]) == 3
    with np.load(path) as found:
        assert set(found.files) == {
            *("coordinates", "force", "displacement"),
            *("std", "std_epistemic", "std_aleatoric"),
        }
        model = surrogate.load(trained_bayes)
        expected = model.predict_distribution(found["force"], passes=7, seed=2).fields()
        for name, field in expected.items():
            np.testing.assert_array_equal(found[name], field)
        free = ~model.geometry.clamped
        assert (found["std_epistemic"][free] > 0).all()
        assert (found["std"] >= found["std_aleatoric"]).all()
    assert main(["predict", str(trained_bayes), *load, "--out", str(out / "u.vtu")]) == 3
    assert "std_epistemic" in (out / "u.vtu").read_text()


def test_predict_warns_outside_training(
    trained: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["predict", str(trained), "--load", "3.5,1.5:0,9", "--out", f"{out}/u.npz"]) == 0
    captured = capsys.readouterr()
    assert captured.err.startswith("surrogate: warning: force components reach beyond")
    assert captured.err.count("surrogate: warning: ") == 2  # the resultant as well


def predict_at_corner(trained: Path, out: Path, *options: str) -> tuple[int, dict[str, np.ndarray]]:
    load = ["--load", "3.5,1.5:0.5,-1", "--out", f"{out}/u.npz"]
    code = main(["predict", str(trained), *load, *options])
    with np.load(out / "u.npz") as file:
        return code, dict(file)


def test_predict_and_certify(trained: Path, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Displacements of the training are made up, so they are not in equilibrium."""
    code, fields = predict_at_corner(trained, out, "--certify")
    assert code == 0
    assert "estimated error" in capsys.readouterr().out
    assert np.abs(fields["estimated_error"]).max() > 1e-3
    code, _ = predict_at_corner(trained, out, "--certify", "--tolerance", "1e-3", *AT_ONCE)
    captured = capsys.readouterr()
    assert code == 3
    assert captured.out.endswith(", not certified\n")
    assert captured.err.startswith("surrogate: not certified: estimated error")
    assert captured.err.endswith("> 1 mm\n")


@pytest.mark.parametrize("likelihood", ["deterministic", "maximum_likelihood"])
def test_fast_certificate(
    make_run: Callable[..., Path],
    data: Path,
    out: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    likelihood: str,
) -> None:
    """17 held-out samples: enough for bounds of 90 %, not of 95 %."""
    run = make_run(epochs=2, calibration_fraction=0.25, likelihood=likelihood)
    assert predict_code(run, out, "--certify", "fast") == 2
    assert "no fast certificate in the run" in capsys.readouterr().err
    assert main(["evaluate", str(run), "--data", str(data), "--certify"]) == 0
    printed, predicts_std = capsys.readouterr().out, likelihood != "deterministic"
    assert ": fast bounds cover " in printed
    assert (": intervals of its size cover " in printed) == predicts_std
    assert predict_code(run, out, "--certify", "fast") == 2
    assert "--level 0.95: 17 calibration samples, expected at least 19" in capsys.readouterr().err
    fast = ("--certify", "fast", "--level", "0.9")
    code, fields = predict_at_corner(run, out, *fast)
    assert code == 3  # the displacements of the training are made up
    assert "at any node, each with probability 0.9" in capsys.readouterr().out
    assert fields["estimated_error"].shape == fields["displacement"].shape
    assert ("half_width" in fields) == predicts_std
    if predicts_std:  # one factor for the whole field
        moves = fields["std"] > 0
        factors = fields["half_width"][moves] / fields["std"][moves]
        np.testing.assert_allclose(factors, factors[0])
        assert not fields["half_width"][~moves].any()
    code, alone = predict_at_corner(run, out)
    assert code == 3
    assert "half_width" not in alone  # nothing of 95 %
    for module in ("surrogate", "solving"):
        monkeypatch.setattr(f"surrogate.learning.inference.{module}.LEVEL", 0.9)
    code, alone = predict_at_corner(run, out)
    assert code == 3
    assert "estimated_error" not in alone
    assert ("half_width" in alone) == predicts_std
    if predicts_std:
        np.testing.assert_array_equal(alone["half_width"], fields["half_width"])
    code, _ = predict_at_corner(run, out, *fast, "--tolerance", "1e-6", *AT_ONCE)
    assert code == 3
    assert "not certified: bound of the error" in capsys.readouterr().err


def predict_code(run: Path, out: Path, *options: str) -> int:
    load = ["--load", "3.5,1.5:0.5,-1", "--out", f"{out}/u.npz"]
    return main(["predict", str(run), *load, *options])


def test_predict_and_correct(trained: Path, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ("--correct", "--certify", "--tolerance", "1e-6")
    code, fields = predict_at_corner(trained, out, *options)
    assert code == 0
    printed = capsys.readouterr().out
    assert "predicted, corrected in" in printed
    assert printed.endswith(", certified within 0.001 mm\n")
    assert sorted(fields) == [
        *("coordinates", "displacement", "estimated_error", "force", "predicted")
    ]
    model = surrogate.load(trained)
    predicted = model.averaged_passes(fields["force"]).mean
    np.testing.assert_array_equal(fields["predicted"], predicted)
    assert model.certify(fields["force"], fields["displacement"]).max_error < 1e-6
    correction = model.correct(fields["force"])
    np.testing.assert_allclose(correction.displacement, fields["displacement"], atol=1e-6)


def test_train_refusals(
    config: Path,
    data: Path,
    data_3d: Path,
    trained: Path,
    out: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = out / "run"

    def refused(part: str, name: object, folder: Path, target: Path = run) -> None:
        arguments = ["train", name, "--data", folder, "--out", target, "--device", "cpu"]
        assert_refused(arguments, part, out, capsys)

    refused("config 'nothing': no such file", "nothing", data)
    refused("no such dataset", config, out / "nowhere")
    refused("expected a structured one", config, data.parent / "nodal")
    refused("'block3d'", config, data_3d)
    refused("a run with another run.training.epochs = 2", config, data, trained)
    config.write_text(config.read_text().replace("epochs: 2", "epochs: two"))
    refused("key 'training.epochs' = 'two'", config, data)
    config.write_text("name: [")
    refused("not valid YAML", config, data)


def test_damaged_data_is_refused(
    config: Path, data: Path, out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "data"
    shutil.copytree(data, folder)
    path = folder / "shard-00000.h5"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    arguments = ["train", config, "--data", folder, "--out", out / "run", "--device", "cpu"]
    assert_refused(arguments, "shard-00000.h5", out, capsys)


def test_refusals(
    trained: Path,
    trained_bayes: Path,
    evaluated: Path,
    data: Path,
    data_3d: Path,
    out: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    nowhere, path, page = out / "nowhere", out / "u.npz", out / "a.html"

    def predict(
        *options: object, run: Path = trained, load: str = "3.5,1.5:0,1", to: Path = path
    ) -> list[object]:
        return ["predict", run, "--load", load, "--out", to, *options]

    export = ["export", trained_bayes, "--format", "pt2", "--out", out / "a.pt2"]
    onnx = ["--format", "onnx", "--out", out / "model.onnx"]
    evaluate = ["evaluate", trained_bayes, "--data", data]
    same = "3: passes of this network do not differ, expected one with probabilistic"
    many, few = 10**12, "expected 1 at least"
    cases: list[tuple[str, list[object]]] = [
        ("no run there", ["export", nowhere, *onnx]),
        ("expected a file name ending in .onnx", ["export", trained, *onnx[:3], out / "m.pt2"]),
        ("--passes 3: passes of this network do", ["export", trained, *onnx, "--passes", 3]),
        ("--seed 3: expected beside passes", ["export", trained, *onnx, "--seed", 3]),
        (f"passes = {many}, {few}", [*export, "--passes", many]),
        ("no run there", ["evaluate", nowhere, "--data", data]),
        ("'block3d'", ["evaluate", trained, "--data", data_3d]),
        ("no such dataset", ["evaluate", trained, "--data", nowhere]),
        (f"passes = {many}, {few}", [*evaluate, "--passes", many]),
        ("--conformal nan: ", [*evaluate, "--conformal", "nan"]),
        ("no run there", predict(run=nowhere)),
        ("expected X,Y:FX,FY", predict(load="3.5:0,1")),
        ("finite", predict(load="3.5,1.5:0,nan")),
        ("the nearest is at 3.5,1.5", predict(load="3.4,1.5:0,1")),
        ("clamped", predict(load="0,1.5:0,1")),
        (".npz, .vtu, .xdmf", predict(to=out / "u.stl")),
        ("no such folder", predict(to=nowhere / "u.npz")),
        (f"--passes {same}", predict("--passes", 3)),
        (f"--seed {same}", predict("--seed", 3)),
        ("--level 0.9: expected beside certify='fast'", predict("--level", 0.9)),
        ("--tolerance 0.1: expected certify beside", predict("--correct", "--tolerance", 0.1)),
        (f"passes = 0, {few}", predict("--passes", 0, run=trained_bayes)),
        (f"passes = {many}, {few}", predict("--passes", many, run=trained_bayes)),
        ("seed = -1, expected 0 at least", predict("--seed", -1, run=trained_bayes)),
        (f"seed = {2**63}, expected 0 at", predict("--seed", 2**63, run=trained_bayes)),
        ("no run there", ["report", nowhere, "--out", page]),
        ("not evaluated yet", ["report", trained, "--out", page]),
        ("no such folder", ["report", evaluated, "--out", nowhere / "a.html"]),
        ("expected a nodal one", ["report", evaluated, "--nodal", data, "--out", page]),
    ]
    for part, arguments in cases:
        assert_refused(arguments, part, out, capsys)


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("predct beam2d_any", "predict"),
        ("predict beam2d_any --laod 4,1:0,-1 --out u.npz", "--load"),
        ("predict beam2d_an --load 4,1:0,-1 --out u.npz", "beam2d_any"),
        ("train det-fats --data data --out run", "det-fast"),
    ],
)
def test_nearly_right_words(words: str, meant: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(words.split())
    except SystemExit as ended:
        code = int(str(ended.code))
    assert code == 2
    assert capsys.readouterr().err.endswith(f"; did you mean '{meant}'?\n")


@pytest.mark.parametrize("arguments", [[], ["fly"], ["train"], ["predict", "run"]])
def test_wrong_usage(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert "usage: surrogate" in capsys.readouterr().err


def test_failed_work_exits_with_one(
    tmp_path: Path,
    data: Path,
    out: Path,
    make_config: Callable[..., UNetModel],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / "wild.yaml"
    monkeypatch.setattr(ScheduleConfig, "factor", lambda *_: 1e30)
    path.write_text(yaml.safe_dump(make_config("adam", learning_rate=1.0).plain()))
    command = ["train", str(path), "--data", str(data), "--out", str(out / "run")]
    assert main([*command, "--device", "cpu"]) == 1
    assert capsys.readouterr().err.startswith("surrogate: failed: diverged in epoch ")


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"network": {"levels": 4, "channels": 2048}}, "keys 'network', 'ensemble', "),
        ({"network": {"levels": 2, "channels": 2048}, "ensemble": 100}, "keys 'network', 'ensemb"),
        (
            {"model": "pod", "pod": {"regression": "gp"}, "likelihood": "maximum_likelihood"},
            "key 'pod': the fit",
        ),
    ],
    ids=["network", "ensemble", "gaussian-process"],
)
def test_networks_larger_than_the_memory_are_refused(
    tmp_path: Path,
    data: Path,
    out: Path,
    change: dict[str, Any],
    part: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The first network has 65536 channels at its coarsest level: 39 · 10⁹ weights a kernel."""
    if "pod" in change:  # 46 samples need 85 kB
        monkeypatch.setattr("shared_schema.common.machine.available_memory", lambda: 80_000)
        monkeypatch.setattr("surrogate.learning.data.dataset.require_memory", lambda *_: None)
    path = tmp_path / "large.yaml"
    path.write_text(yaml.safe_dump({"name": "large", "case": "beam2d", **change}))
    arguments = ["train", path, "--data", data, "--out", out / "run", "--device", "cpu"]
    assert_refused(arguments, f"config 'large': {part}", out, capsys)
    capsys.readouterr()
    assert main([str(a) for a in arguments]) == 2
    assert "GiB of memory at least, expected at most the " in capsys.readouterr().err


@pytest.mark.parametrize(
    "error",
    [
        MemoryError("Unable to allocate 9 GiB"),
        RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried to allocate 9 bytes."),
        OSError(12, "Cannot allocate memory"),
        RuntimeError("can't start new thread"),
        torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 9 GiB."),
    ],
    ids=["numpy", "torch", "system", "thread", "cuda"],
)
def test_lack_of_memory_is_failed_work(
    trained: Path,
    out: Path,
    error: Exception,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    command = ["predict", str(trained), "--load", "3.5,1.5:0,1", "--out", str(out / "u.npz")]
    for place in (
        "surrogate.learning.inference.loading.make_surrogate",
        "surrogate.runtime.tensor_file.safe_open",
        "surrogate.learning.inference.surrogate.Surrogate.averaged_passes",
    ):
        with monkeypatch.context() as patch:
            patch.setattr(place, fail)
            assert main(command) == 1
        message = capsys.readouterr().err
        assert message.startswith("surrogate: failed: out of memory (")
        assert message.count("\n") == 1
    assert list(out.iterdir()) == []


def test_output_that_nobody_reads(trained: Path, out: Path) -> None:
    """`surrogate predict … | true`: no complaint about the pipe."""
    command = [sys.executable, "-m", "surrogate.command_line", "predict", str(trained)]
    command += ["--load", "3.5,1.5:0,1", "--out", str(out / "u.npz")]
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "wb") as pipe:
        done = subprocess.run(command, stdout=pipe, stderr=subprocess.PIPE, check=False, text=True)
    assert done.stderr == ""
    assert (out / "u.npz").is_file()
