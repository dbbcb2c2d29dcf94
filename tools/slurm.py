"""A stand-in for SLURM, for tests of the job scripts in `docs/slurm`.

A job script is started by bash in a folder of its own. ``srun``, ``scancel`` and ``scontrol`` are
small scripts at the front of its ``PATH``: a job step runs on this machine, and requests to the
scheduler are written to a file.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

JOB = "4711"
NODE_LIST, ADDRESSES = "node[1-2]", ("127.0.0.1", "127.0.0.2")
STAND_INS = {
    # Skips its own options, appends number of tasks and command to `ran`, and runs all tasks of the
    # step. Their process numbers are in `step`; the exit code is that of the last task that failed.
    "srun": """
tasks={tasks}
while [[ $1 == --* ]]; do [[ $1 == --ntasks=* ]] && tasks=${{1#*=}}; shift; done
echo "$tasks $@" >> ran
exec 3>&1
for ((task = 0; task < tasks; task++)); do "$@" >&3 3>&- & echo $!; done > step
code=0
for task in $(< step); do wait "$task" || code=$?; done
exit $code""",
    "scancel": """
[ "$*" = "--signal=TERM {job}" ] && kill -TERM $(< step)""",
    "scontrol": """
if [ "$*" = "show hostnames {node_list}" ]; then printf '%s\\n' {addresses}
else echo "$@" >> requests; fi""",
}


class SlurmJob:
    """A job script with a folder in which it is run.

    Parameters
    ----------
    script : Path
        The job script.
    folder : Path
        An empty folder, the working folder of the job.
    tasks : int
        Number of tasks of a job step that does not say ``--ntasks``.

    Attributes
    ----------
    folder, bin : Path
        The working folder, and the folder in it of the programs that are first on ``PATH``.
    """

    def __init__(self, script: Path, folder: Path, tasks: int) -> None:
        self._script = script
        self.folder = folder
        self.bin = folder / "bin"
        self.bin.mkdir()
        addresses = " ".join(ADDRESSES)
        for name, body in STAND_INS.items():
            values = {"tasks": tasks, "job": JOB, "node_list": NODE_LIST, "addresses": addresses}
            self.add_program(name, body.format(**values))

    def add_program(self, name: str, body: str) -> None:
        """Put a bash script onto the ``PATH`` of the job."""
        path = self.bin / name
        path.write_text(f"#!/bin/bash\n{body}\n")
        path.chmod(0o755)

    def submit(
        self, variables: Mapping[str, str], inherited: Mapping[str, str] = os.environ
    ) -> subprocess.Popen[str]:
        """Start the script as SLURM does, with environment variables beside the inherited ones."""
        path = f"{self.bin}:{Path(sys.executable).parent}:{os.environ['PATH']}"
        return subprocess.Popen(
            ["bash", str(self._script)],
            cwd=self.folder,
            env={**inherited, "PATH": path, "SLURM_JOB_ID": JOB, **variables},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    @property
    def steps(self) -> list[str]:
        """Number of tasks and command of every job step so far."""
        ran = self.folder / "ran"
        return ran.read_text().splitlines() if ran.exists() else []

    def take_requests(self) -> list[str]:
        """Requests to the scheduler since the last call."""
        path = self.folder / "requests"
        requests = path.read_text().splitlines() if path.exists() else []
        path.unlink(missing_ok=True)
        return requests


def finish(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Wait for a script; return its exit code and standard error."""
    _, said = process.communicate(timeout=240)
    return process.returncode, said


def terminate_when(process: subprocess.Popen[str], condition: Callable[[], bool]) -> None:
    """Send SIGTERM to a script as soon as a condition holds."""
    limit = time.monotonic() + 120
    while not condition():
        assert process.poll() is None, "ended before it could be stopped"
        assert time.monotonic() < limit
        time.sleep(0.02)
    process.send_signal(signal.SIGTERM)


def sbatch_options(script: Path) -> list[str]:
    """Options of a valid bash script to sbatch, which reads none behind the first command."""
    subprocess.run(["bash", "-n", str(script)], check=True)
    lines = script.read_text().splitlines()
    commands = [i for i, line in enumerate(lines) if line and not line.startswith("#")]
    options = [i for i, line in enumerate(lines) if line.startswith("#SBATCH ")]
    assert max(options) < min(commands)
    return [lines[i].removeprefix("#SBATCH ") for i in options]


def expanded(words: str, variables: Mapping[str, str], before: str = "") -> list[str]:
    """Words of a command line as bash expands them, after the assignments `before`."""
    return subprocess.run(
        ["bash", "-c", f"{before}printf '%s\\n' {words}"],
        env=dict(variables),
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
