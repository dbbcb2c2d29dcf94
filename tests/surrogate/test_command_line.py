"""Every command: 0 and a line on stdout, or 2, a line on stderr and nothing written."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

import surrogate
from surrogate.command_line import main
from surrogate.run_config import RunConfig


@pytest.fixture
def config(tmp_path: Path, make_config: Callable[..., RunConfig]) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(yaml.safe_dump(make_config(epochs=2).plain()))
    return path


@pytest.fixture
def out(tmp_path: Path) -> Path:
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


def assert_refused(
    arguments: list[object], part: str, out: Path, capsys: pytest.CaptureFixture[str]
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
    assert "stopped, to be gone on with, 1 of 2 epochs" in capsys.readouterr().out
    assert not (out / "run" / "model.safetensors").exists()
    assert main([*command, "--device", "cpu"]) == 0
    assert "trained, 2 of 2 epochs" in capsys.readouterr().out
    assert (out / "run" / "model.safetensors").is_file()


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
    assert main(["predict", str(trained), *loads, "--out", str(path)]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    assert captured.out == f"{path}: predicted\n"
    if suffix == ".npz":
        with np.load(path) as found:
            # spacing 0.5: (3.5, 1.5) is grid point (7, 3), node 31; (2, 1.5) is (4, 3), node 19
            expected = np.zeros((32, 2))
            expected[31], expected[19] = (0.5, -1), (0, 1)
            np.testing.assert_array_equal(found["force"], expected)
            predicted = surrogate.load(trained).predict(expected)
            np.testing.assert_array_equal(found["displacement"], predicted)


def test_predict_warns_outside_training(
    trained: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["predict", str(trained), "--load", "3.5,1.5:0,9", "--out", f"{out}/u.npz"]) == 0
    captured = capsys.readouterr()
    assert captured.err.startswith("surrogate: warning: force components reach beyond")
    assert captured.err.count("\n") == 1


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


def test_evaluate_refusals(
    trained: Path,
    data: Path,
    data_3d: Path,
    tmp_path: Path,
    out: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = out / "run"
    shutil.copytree(trained, run)
    cases = [(out / "nowhere", data, "no run there"), (run, data_3d, "'block3d'")]
    cases += [(run, tmp_path / "nowhere", "no such dataset")]
    for folder, dataset, part in cases:
        arguments = ["evaluate", folder, "--data", dataset, "--device", "cpu"]
        assert_refused(arguments, part, out, capsys)


def test_predict_refusals(trained: Path, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cases = [
        (out / "nowhere", "3.5,1.5:0,1", out / "u.npz", "no run there"),
        (trained, "3.5:0,1", out / "u.npz", "expected X,Y:FX,FY"),
        (trained, "3.5,1.5:0,nan", out / "u.npz", "finite"),
        (trained, "3.4,1.5:0,1", out / "u.npz", "the nearest is at 3.5,1.5"),
        (trained, "0,1.5:0,1", out / "u.npz", "clamped"),
        (trained, "3.5,1.5:0,1", out / "u.stl", ".npz, .vtu, .xdmf"),
        (trained, "3.5,1.5:0,1", out / "nowhere" / "u.npz", "no such folder"),
    ]
    for run, load, path, part in cases:
        assert_refused(["predict", run, "--load", load, "--out", path], part, out, capsys)


def test_report_refusals(
    trained: Path, evaluated: Path, data: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = out / "a.html"
    cases: list[tuple[list[object], str]] = [
        ([out / "nowhere", "--out", page], "no run there"),
        ([trained, "--out", page], "not evaluated yet"),
        ([evaluated, "--out", out / "nowhere" / "a.html"], "no such folder"),
        ([evaluated, "--nodal", data, "--out", page], "expected a nodal one"),
    ]
    for arguments, part in cases:
        assert_refused(["report", *arguments], part, out, capsys)


@pytest.mark.parametrize("arguments", [[], ["fly"], ["train"], ["predict", "run", "--out", "a"]])
def test_wrong_usage(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert "usage: surrogate" in capsys.readouterr().err


def test_failed_work_exits_with_one(
    tmp_path: Path,
    data: Path,
    out: Path,
    make_config: Callable[..., RunConfig],
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "wild.yaml"
    path.write_text(yaml.safe_dump(make_config("adam", learning_rate=1e30).plain()))
    command = ["train", str(path), "--data", str(data), "--out", str(out / "run")]
    assert main([*command, "--device", "cpu"]) == 1
    assert capsys.readouterr().err.startswith("surrogate: failed: diverged in epoch ")
