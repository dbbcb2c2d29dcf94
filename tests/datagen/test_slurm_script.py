"""The SLURM script of the factory, run with a stand-in for SLURM."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from datagen.command_line import _parser
from shared_schema.checker import check_dataset
from shared_schema.manifest import read_manifest
from tests.datagen.farm_runs import datagen, held
from tools.slurm import JOB, SlurmJob, expanded, finish, sbatch_options, terminate_when

SCRIPT = Path(__file__).parents[2] / "docs" / "slurm" / "datagen.sbatch"


@pytest.fixture
def job(tmp_path: Path) -> SlurmJob:
    return SlurmJob(SCRIPT, tmp_path, tasks=1)


def test_options_of_sbatch() -> None:
    assert {"--signal=B:TERM@120", "--requeue"} <= set(sbatch_options(SCRIPT))


def test_datagen_accepts_every_command() -> None:
    text = SCRIPT.read_text().replace("\\\n", " ")
    commands = re.findall(r"^[^#\n]*?\bdatagen ((?:run|structure|check|info) [^&\n]*)", text, re.M)
    assert len(commands) == 4
    for samples in ("", "12"):
        for command in commands:
            variables = {"CASE": "beam3d", "DATA": "data/a b", "SAMPLES": samples}
            words = expanded(command, variables)
            options = vars(_parser().parse_args(words))
            assert Path("data/a b/nodal") in options.values() or words[0] == "check"
            assert options.get("samples") == (12 if samples and words[0] == "run" else None)


@pytest.mark.slow
def test_a_dataset_is_made(job: SlurmJob) -> None:
    code, said = finish(job.submit({"CASE": "beam2d", "SAMPLES": "40"}))
    assert code == 0, said
    steps = [shlex.split(step)[:3] for step in job.steps]
    assert steps == [["1", "datagen", name] for name in ("run", "structure", "check", "check")]
    for kind in ("nodal", "structured"):
        assert check_dataset(job.folder / "data" / "beam2d" / kind) == []
    assert job.take_requests() == []


@pytest.mark.faults
@pytest.mark.slow
def test_out_of_time(job: SlurmJob) -> None:
    """TERM to the script: the step ends by itself, the job is queued again and resumes."""
    nodal = job.folder / "data" / "beam2d" / "nodal"
    variables = {"CASE": "beam2d", "SAMPLES": "750"}  # three shards
    program = held(datagen(), job.folder / "gate", 1)
    job.add_program("datagen", f'exec {shlex.join(program)} "$@"')
    process = job.submit(variables)
    terminate_when(process, lambda: any(nodal.glob(".journal/shard-*.json")))
    code, said = finish(process)
    assert code == 1
    assert "stopped; resume with the same command" in said
    assert job.take_requests() == [f"requeue {JOB}"]
    assert not (nodal / "manifest.json").exists()
    kept = {path: path.stat().st_mtime_ns for path in nodal.glob("shard-*.h5")}
    assert kept

    (job.folder / "gate").unlink()
    code, said = finish(job.submit(variables))
    assert code == 0, said
    assert read_manifest(nodal).samples == 750
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert job.take_requests() == []


@pytest.mark.slow
def test_wrong_input_is_not_tried_again(job: SlurmJob) -> None:
    code, said = finish(job.submit({"CASE": "beam9d"}))
    assert code == 2
    assert "beam9d" in said
    assert len(job.steps) == 1
    assert job.take_requests() == []
    assert not (job.folder / "data").exists()
