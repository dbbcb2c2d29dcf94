"""The SLURM example of training, run on two nodes that are stand-ins, as SLURM's commands are."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from surrogate.command_line import _parser
from surrogate.models.model import Model
from surrogate.models.unet_model import UNetModel
from surrogate.runs.folder import RunFolder
from tests.surrogate.resuming import untimed

MakeConfig = Callable[..., UNetModel]

SCRIPT = Path(__file__).parents[2] / "docs" / "slurm" / "surrogate.sbatch"
JOB = "4711"
NODES = 2
STAND_INS = {
    # drops its own options, says what it runs, and runs it as every task of the step
    "srun": f"""
tasks={NODES}
while [[ $1 == --* ]]; do [[ $1 == --ntasks=* ]] && tasks=${{1#*=}}; shift; done
echo "$tasks $@" >> ran
for ((task = 0; task < tasks; task++)); do "$@" & echo $!; done > step
code=0
for task in $(< step); do wait "$task" || code=$?; done
exit $code""",
    "scancel": f'[ "$*" = "--signal=TERM {JOB}" ] && kill -TERM $(< step)',
    "scontrol": """
if [ "$*" = "show hostnames node[1-2]" ]; then printf '127.0.0.1\\n127.0.0.2\\n'
else echo "$@" >> asked_of_slurm; fi""",
}


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """The folder that a job starts in, with the stand-ins in ``bin``."""
    (tmp_path / "bin").mkdir()
    for name, body in STAND_INS.items():
        path = tmp_path / "bin" / name
        path.write_text(f"#!/bin/bash\n{body}\n")
        path.chmod(0o755)
    return tmp_path


def submit(folder: Path, config: Model, data: Path) -> subprocess.Popen[str]:
    """Start the script as SLURM does, on two nodes without GPUs."""
    path = folder / "small.yaml"
    path.write_text(yaml.safe_dump(config.plain()))
    variables = {
        "PATH": f"{folder / 'bin'}:{Path(sys.executable).parent}:{os.environ['PATH']}",
        "SLURM_JOB_ID": JOB,
        "SLURM_JOB_NODELIST": "node[1-2]",
        "SLURM_NNODES": str(NODES),
        "CONFIG": str(path),
        "DATA": str(data.parent),
        "RUN": "runs/small",
    }
    return subprocess.Popen(
        ["bash", str(SCRIPT)],
        cwd=folder,
        env=os.environ | variables,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code and standard error of the script."""
    _, said = process.communicate(timeout=240)
    return process.returncode, said


def test_valid_bash() -> None:
    subprocess.run(["bash", "-n", str(SCRIPT)], check=True)


def test_options_of_sbatch_come_first() -> None:
    """Sbatch reads no options behind the first command."""
    lines = SCRIPT.read_text().splitlines()
    commands = [i for i, line in enumerate(lines) if line and not line.startswith("#")]
    options = [i for i, line in enumerate(lines) if line.startswith("#SBATCH ")]
    assert max(options) < min(commands)
    assert {"#SBATCH --ntasks-per-node=1", "#SBATCH --requeue"} <= set(lines)


def test_surrogate_accepts_every_command() -> None:
    """With the configuration that the script names, a shipped one."""
    text = SCRIPT.read_text().replace("\\\n", " ")
    commands = re.findall(r"\b(?:surrogate|command_line) ((?:train|evaluate) [^&\n]*)", text)
    assert [command.split()[0] for command in commands] == ["train", "evaluate"]
    defaults = "".join(re.findall(r"^(?:CONFIG|DATA|RUN)=.*\n", text, re.M))
    for command in commands:
        words = subprocess.run(
            ["bash", "-c", f"{defaults}printf '%s\\n' {command}"],
            env={},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.splitlines()
        options = _parser().parse_args(words)
        assert options.data == Path("data/beam2d/structured")
        run = options.out if words[0] == "train" else options.run
        assert run == Path("runs/beam2d-det-fast")


def test_every_node_has_its_own_processes(job: Path) -> None:
    """As many as it has GPUs, of whose cores each takes its share."""
    (job / "bin" / "torchrun").write_text('#!/bin/bash\necho "$OMP_NUM_THREADS $@" >> started\n')
    (job / "bin" / "torchrun").chmod(0o755)
    (job / "bin" / "surrogate").symlink_to("/bin/true")
    slurm = {
        "SLURM_JOB_NODELIST": "node[1-2]",
        "SLURM_NNODES": "2",
        "SLURM_GPUS_ON_NODE": "2",
        "SLURM_CPUS_PER_TASK": "8",
        "SLURM_JOB_ID": JOB,
        "PATH": f"{job / 'bin'}:{os.environ['PATH']}",
    }
    subprocess.run(["bash", str(SCRIPT)], cwd=job, env=slurm, check=True)
    started = (job / "started").read_text().splitlines()
    assert len(started) == 2
    for line in started:
        assert line.startswith("4 --nnodes 2 --nproc-per-node 2 ")
        assert " --rdzv-endpoint 127.0.0.1:24711 " in line


@pytest.mark.slow
def test_two_nodes_train_and_one_evaluates(job: Path, data: Path, make_config: MakeConfig) -> None:
    code, said = finish(submit(job, make_config(epochs=3), data))
    assert code == 0, said
    run = RunFolder(job / "runs" / "small")
    assert [line["epoch"] for line in run.metric_lines()] == [1, 2, 3]
    assert run.evaluation.is_file()
    steps = [line.split()[:2] for line in (job / "ran").read_text().splitlines()]
    assert steps == [["2", "torchrun"], ["1", "surrogate"]]
    assert not (job / "asked_of_slurm").exists()


@pytest.mark.slow
def test_out_of_time(job: Path, data: Path, make_config: MakeConfig) -> None:
    """TERM to the script: the step ends, the job is queued again, and then goes on."""
    config = make_config(epochs=60, checkpoint_seconds=0)
    run = RunFolder(job / "runs" / "small")
    process = submit(job, config, data)
    limit = time.monotonic() + 120
    while not run.checkpoint.is_file():
        assert process.poll() is None, "ended before it could be stopped"
        assert time.monotonic() < limit
        time.sleep(0.02)
    process.send_signal(signal.SIGTERM)
    code, said = finish(process)
    assert code == 1, said
    assert (job / "asked_of_slurm").read_text() == f"requeue {JOB}\n"
    assert not run.model.exists()
    before = untimed(run)
    assert 0 < len(before) < 60

    (job / "asked_of_slurm").unlink()
    code, said = finish(submit(job, config, data))
    assert code == 0, said
    assert [line["epoch"] for line in run.metric_lines()] == list(range(1, 61))
    assert untimed(run)[: len(before) - 1] == before[:-1]
    assert not (job / "asked_of_slurm").exists()


@pytest.mark.slow
def test_wrong_input_is_not_tried_again(job: Path, data: Path, make_config: MakeConfig) -> None:
    code, said = finish(submit(job, make_config(batch_size=1), data))
    assert code == 1
    assert "'training.batch_size' = 1, expected 2 at least, the number of processes" in said
    assert len((job / "ran").read_text().splitlines()) == 1
    assert not (job / "asked_of_slurm").exists()
    assert not (job / "runs").exists()
