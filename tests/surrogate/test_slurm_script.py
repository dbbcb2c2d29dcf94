"""The SLURM script of the learner, run on two nodes of a stand-in for SLURM."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from surrogate.command_line import _parser
from surrogate.learning.models.model import Model
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.folder import RunFolder
from tests.surrogate.resuming import untimed
from tools.slurm import JOB, NODE_LIST, SlurmJob, expanded, finish, sbatch_options, terminate_when

MakeConfig = Callable[..., UNetModel]

SCRIPT = Path(__file__).parents[2] / "docs" / "slurm" / "surrogate.sbatch"
# As `surrogate`, but waits in the fourth epoch as long as there is a file `gate`.
HELD = """
import sys, time
from pathlib import Path
from surrogate.command_line import main
from surrogate.learning.training import trainer
epoch = trainer.Trainer.train_epoch
def wait_and_train(*arguments):
    while arguments[1] == 3 and Path("gate").exists():
        time.sleep(0.01)
    return epoch(*arguments)
trainer.Trainer.train_epoch = wait_and_train
sys.exit(main())
"""
TWO_NODES = {"SLURM_JOB_NODELIST": NODE_LIST, "SLURM_NNODES": "2"}


@pytest.fixture
def job(tmp_path: Path) -> SlurmJob:
    return SlurmJob(SCRIPT, tmp_path, tasks=2)


def submit(job: SlurmJob, config: Model, data: Path) -> subprocess.Popen[str]:
    """Start the script as SLURM does, on two nodes without GPUs."""
    path = job.folder / "small.yaml"
    path.write_text(yaml.safe_dump(config.plain()))
    variables = {"CONFIG": str(path), "DATA": str(data.parent), "RUN": "runs/small"}
    return job.submit(TWO_NODES | variables)


def test_options_of_sbatch() -> None:
    assert {"--ntasks-per-node=1", "--requeue"} <= set(sbatch_options(SCRIPT))


def test_surrogate_accepts_every_command() -> None:
    """With the configuration that the script names, a shipped one."""
    text = SCRIPT.read_text().replace("\\\n", " ")
    commands = re.findall(r"\b(?:surrogate|command_line) ((?:train|evaluate) [^&\n]*)", text)
    assert [command.split()[0] for command in commands] == ["train", "evaluate"]
    defaults = "".join(re.findall(r"^(?:CONFIG|DATA|RUN)=.*\n", text, re.M))
    for command in commands:
        words = expanded(command, {}, defaults)
        options = _parser().parse_args(words)
        data = Path("data/beam2d/structured")
        assert options.data == ([data] if words[0] == "train" else data)
        run = options.out if words[0] == "train" else options.run
        assert run == Path("runs/beam2d-det-fast")


def test_every_node_has_its_own_processes(job: SlurmJob) -> None:
    """As many as it has GPUs, of whose cores each takes its share."""
    job.add_program("torchrun", 'echo "$OMP_NUM_THREADS $@" >> started')
    job.add_program("surrogate", "true")
    slurm = TWO_NODES | {"SLURM_GPUS_ON_NODE": "2", "SLURM_CPUS_PER_TASK": "8"}
    code, said = finish(job.submit(slurm, inherited={}))
    assert code == 0, said
    started = (job.folder / "started").read_text().splitlines()
    assert len(started) == 2
    for line in started:
        assert line.startswith("4 --nnodes 2 --nproc-per-node 2 ")
        assert " --rdzv-endpoint 127.0.0.1:24711 " in line


@pytest.mark.faults
@pytest.mark.slow
def test_out_of_time(job: SlurmJob, data: Path, make_config: MakeConfig) -> None:
    """TERM to the script: the step ends, the job is queued again and resumes.

    Then both nodes train until the end, and one evaluates.
    """
    config = make_config(epochs=6, checkpoint_seconds=0)
    run, gate = RunFolder(job.folder / "runs" / "small"), job.folder / "gate"
    (job.folder / "held.py").write_text(HELD)
    torchrun = Path(sys.executable).parent / "torchrun"
    job.add_program("torchrun", f'exec {torchrun} "${{@/surrogate.command_line/held}}"')
    gate.touch()
    process = submit(job, config, data)
    terminate_when(process, run.checkpoint.is_file)
    code, said = finish(process)
    assert code == 1, said
    assert job.take_requests() == [f"requeue {JOB}"]
    assert not run.model.exists()
    before = untimed(run)
    assert 0 < len(before) < 6
    assert [step.split()[:2] for step in job.steps] == [["2", "torchrun"]]

    gate.unlink()
    code, said = finish(submit(job, config, data))
    assert code == 0, said
    assert [line["epoch"] for line in run.metric_lines()] == list(range(1, 7))
    assert untimed(run)[: len(before) - 1] == before[:-1]
    assert run.evaluation.is_file()
    steps = [step.split()[:2] for step in job.steps]
    assert steps[1:] == [["2", "torchrun"], ["1", "surrogate"]]
    assert job.take_requests() == []


@pytest.mark.slow
def test_wrong_input_is_not_tried_again(job: SlurmJob, data: Path, make_config: MakeConfig) -> None:
    code, said = finish(submit(job, make_config(batch_size=1), data))
    assert code == 1
    assert "'training.batch_size' = 1, expected 2 at least, the number of processes" in said
    assert len(job.steps) == 1
    assert job.take_requests() == []
    assert not (job.folder / "runs").exists()
