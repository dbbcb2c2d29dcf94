"""Full and read-only disks, kills and two programs at once: nothing half-written, files named."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

from surrogate.command_line import main
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.folder import RunFolder
from tools.small_disk import SmallDisk

pytestmark = pytest.mark.faults

# Runs commands one after another, and prints the exit code and standard error of each.
IN_TURN = """
import io, json, sys
from contextlib import redirect_stderr
from experiments.__main__ import main as experiments
from surrogate.command_line import main as surrogate
for command in json.loads(sys.argv[1]):
    program = experiments if command[0] == "reproduce" else surrogate
    with redirect_stderr(io.StringIO()) as error:
        code = program(command)
    print(json.dumps([code, error.getvalue()]))
"""
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1"}


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[SmallDisk]:
    disk = SmallDisk(tmp_path / "disk", "size=4m")
    yield disk
    disk.close()


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def run_on(disk: SmallDisk, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run Python with some arguments."""
    words = disk.words([sys.executable, *map(str, arguments)])
    return subprocess.run(
        words, env=ENVIRONMENT, capture_output=True, text=True, check=False, timeout=120
    )


@pytest.mark.slow
def test_evaluate_on_a_full_disk_keeps_the_evaluation_before(
    evaluated: Path, data: Path, make_dataset: Callable[..., Path], tmp_path: Path, disk: SmallDisk
) -> None:
    shutil.copytree(evaluated, disk.seen / "run")
    before = content(disk.seen / "run")
    with (disk.seen / "ballast").open("wb") as file:
        free = os.statvfs(disk.seen)
        file.write(bytes(free.f_bavail * free.f_bsize - 60_000))  # less than two figures
    other = make_dataset(tmp_path / "other", seed=1)
    evaluate = ("-m", "surrogate.command_line", "evaluate", disk.folder / "run", "--data", other)
    done = run_on(disk, *evaluate)
    assert done.returncode == 1
    assert "No space left on device: " in done.stderr
    assert done.stderr.count("\n") == 1
    assert content(disk.seen / "run") == before
    (disk.seen / "ballast").unlink()
    assert run_on(disk, *evaluate).returncode == 0
    assert content(disk.seen / "run")["evaluation.json"] != before["evaluation.json"]


@pytest.mark.slow
def test_read_only_targets_are_wrong_input(
    evaluated: Path,
    data: Path,
    tmp_path: Path,
    disk: SmallDisk,
    make_config: Callable[..., UNetModel],
) -> None:
    shutil.copytree(evaluated, disk.seen / "run")
    config = tmp_path / "config.yaml"
    config.write_text(yaml.safe_dump(make_config().plain()))
    disk.remount("ro")
    run, folder = disk.folder / "run", disk.folder
    load = ["--load", "3.5,1.5:0,1"]
    commands: list[list[object]] = [
        ["train", config, "--data", data, "--out", folder / "new"],
        ["evaluate", run, "--data", data],
        ["predict", run, *load, "--out", folder / "u.npz"],
        ["export", run, "--format", "pt2", "--out", folder / "a.pt2"],
        ["report", run, "--out", folder / "a.html"],
        ["reproduce", "--scale", "smoke", "--out", folder / "report"],
    ]
    done = run_on(disk, "-c", IN_TURN, json.dumps(commands, default=str))
    assert done.returncode == 0, done.stderr
    results = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(results) == len(commands)
    for code, said in results:
        assert (code, said.count("\n")) == (2, 1), said
        assert f"{folder}" in said
        assert "cannot be written to (Read-only file system)" in said


def test_figures_that_a_killed_process_left_half_written_are_removed(
    evaluated: Path, data: Path, tmp_path: Path
) -> None:
    run = RunFolder(tmp_path / "run")
    shutil.copytree(evaluated, run.folder)
    for folder in (run.folder, run.figures):
        (folder / ".partial-4711-errors.png").write_bytes(b"half")
    (run.figures / "sweep.png").write_bytes(b"of an evaluation before")
    assert main(["evaluate", str(run.folder), "--data", str(data), "--device", "cpu"]) == 0
    names = sorted(path.name for path in run.figures.iterdir())
    assert names == ["deformed.png", "error_field.png", "errors.png", "loss.png", "von_mises.png"]
    assert not list(run.folder.glob(".*"))


WAITING = """
import sys, time
from surrogate.command_line import main
from surrogate.learning.training import trainer
epoch = trainer.Trainer.train_epoch
def waiting(*arguments):
    if arguments[1] == 1:
        print("ready", flush=True)
        sys.stdin.readline()
    return epoch(*arguments)
trainer.Trainer.train_epoch = waiting
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_the_second_of_two_trainings_in_one_folder_refuses(
    data: Path,
    tmp_path: Path,
    make_config: Callable[..., UNetModel],
    capsys: pytest.CaptureFixture[str],
) -> None:
    config, run = tmp_path / "config.yaml", RunFolder(tmp_path / "run")
    config.write_text(yaml.safe_dump(make_config(epochs=3, checkpoint_seconds=0.0).plain()))
    command = ["train", str(config), "--data", str(data), "--out", str(run.folder)]
    for ends_by_itself in (True, False):
        first = subprocess.Popen(
            [sys.executable, "-c", WAITING, *command],
            env=ENVIRONMENT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert first.stdin is not None
        assert first.stdout is not None
        assert first.stdout.readline() == "ready\n"
        before = run.metrics.read_bytes()
        assert main(command) == 2
        message = f"--out '{run.folder}': another run is working in it (process {first.pid} on "
        assert message in capsys.readouterr().err
        assert run.metrics.read_bytes() == before
        if ends_by_itself:
            first.communicate("go on\n")
            assert first.returncode == 0
            shutil.rmtree(run.folder)
        else:
            first.send_signal(signal.SIGKILL)
            first.communicate()
    assert main(command) == 0  # the lock of the killed one does not stay
    assert [line["epoch"] for line in run.metric_lines()] == [1, 2, 3]
    assert not list(run.folder.glob(".*"))
