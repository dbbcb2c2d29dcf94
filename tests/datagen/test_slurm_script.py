"""The SLURM example, run with stand-ins for SLURM's commands."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from datagen.command_line import _parser
from shared_schema.checker import check_dataset
from shared_schema.manifest import read_manifest

SCRIPT = Path(__file__).parents[2] / "docs" / "slurm" / "datagen.sbatch"
JOB = "4711"
STAND_INS = {
    # drops its own options, says what it runs, and becomes the one task of the step
    "srun": 'while [[ $1 == --* ]]; do shift; done; echo $$ > step; echo "$@" >> ran; exec "$@"',
    "scancel": f'[ "$*" = "--signal=TERM {JOB}" ] && kill -TERM "$(cat step)"',
    "scontrol": 'echo "$@" >> asked_of_slurm',
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


def submit(folder: Path, **variables: str) -> subprocess.Popen[str]:
    """Start the script as SLURM does."""
    path = f"{folder / 'bin'}:{Path(sys.executable).parent}:{os.environ['PATH']}"
    return subprocess.Popen(
        ["bash", str(SCRIPT)],
        cwd=folder,
        env=os.environ | {"PATH": path, "SLURM_JOB_ID": JOB} | variables,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code and standard error of the script."""
    _, said = process.communicate(timeout=120)
    return process.returncode, said


def test_valid_bash() -> None:
    subprocess.run(["bash", "-n", str(SCRIPT)], check=True)


def test_options_of_sbatch_come_first() -> None:
    """Sbatch reads no options behind the first command."""
    lines = SCRIPT.read_text().splitlines()
    commands = [i for i, line in enumerate(lines) if line and not line.startswith("#")]
    options = [i for i, line in enumerate(lines) if line.startswith("#SBATCH ")]
    assert max(options) < min(commands)
    assert "#SBATCH --signal=B:TERM@120" in lines
    assert "#SBATCH --requeue" in lines


def test_datagen_accepts_every_command() -> None:
    text = SCRIPT.read_text().replace("\\\n", " ")
    commands = re.findall(r"^[^#\n]*?\bdatagen ((?:run|structure|check|info) [^&\n]*)", text, re.M)
    assert len(commands) == 4
    for samples in ("", "12"):
        for command in commands:
            expanded = subprocess.run(
                ["bash", "-c", f"printf '%s\\n' {command}"],
                env={"CASE": "beam3d", "DATA": "data/a b", "SAMPLES": samples},
                capture_output=True,
                text=True,
                check=True,
            ).stdout.splitlines()
            options = vars(_parser().parse_args(expanded))
            assert Path("data/a b/nodal") in options.values() or expanded[0] == "check"
            assert options.get("samples") == (12 if samples and expanded[0] == "run" else None)


@pytest.mark.slow
def test_a_dataset_is_made(job: Path) -> None:
    code, said = finish(submit(job, CASE="beam2d", SAMPLES="40"))
    assert code == 0, said
    commands = [shlex.split(line)[:2] for line in (job / "ran").read_text().splitlines()]
    assert [name for _, name in commands] == ["run", "structure", "check", "check"]
    for kind in ("nodal", "structured"):
        assert check_dataset(job / "data" / "beam2d" / kind) == []
    assert not (job / "asked_of_slurm").exists()


@pytest.mark.slow
def test_out_of_time(job: Path) -> None:
    """TERM to the script: the step ends by itself, the job is queued again, and then goes on."""
    nodal = job / "data" / "beam2d" / "nodal"
    process = submit(job, CASE="beam2d", SAMPLES="4000")
    limit = time.monotonic() + 120
    while not list(nodal.glob(".journal/shard-*.json")):
        assert process.poll() is None, "ended before it could be stopped"
        assert time.monotonic() < limit
        time.sleep(0.02)
    process.send_signal(signal.SIGTERM)
    code, said = finish(process)
    assert code == 1
    assert "stopped; resume with the same command" in said
    assert (job / "asked_of_slurm").read_text() == f"requeue {JOB}\n"
    assert not (nodal / "manifest.json").exists()
    kept = {path: path.stat().st_mtime_ns for path in nodal.glob("shard-*.h5")}
    assert kept

    (job / "asked_of_slurm").unlink()
    code, said = finish(submit(job, CASE="beam2d", SAMPLES="4000"))
    assert code == 0, said
    assert read_manifest(nodal).samples == 4000
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert not (job / "asked_of_slurm").exists()


@pytest.mark.slow
def test_wrong_input_is_not_tried_again(job: Path) -> None:
    code, said = finish(submit(job, CASE="beam9d"))
    assert code == 2
    assert "beam9d" in said
    assert len((job / "ran").read_text().splitlines()) == 1
    assert not (job / "asked_of_slurm").exists()
    assert not (job / "data").exists()
