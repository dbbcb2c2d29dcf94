"""A Python process of one program that has its libraries loaded and forks for every command.

Run as ``python -m tools.fuzz.worker PROGRAM`` it reads one request a line (JSON) from standard
input, and writes one answer a line to standard output.
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import signal
import subprocess
import sys
import time
import traceback
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
PRELOADED = {  # nothing that begins MPI or starts threads
    "datagen": ("scipy.sparse", "scipy.spatial", "h5py", "meshio", "shared_schema.dataset_reader"),
    "surrogate": (
        "torch",
        "surrogate",
        "surrogate.learning.training.loop",
        "surrogate.learning.evaluation.run_evaluation",
    ),
}
MEMORY = 16 * 2**30  # bytes of address space that a command may take
POLL = 0.005


class Worker:
    """Client of a worker process.

    Parameters
    ----------
    program : {"datagen", "surrogate"}
    """

    def __init__(self, program: str) -> None:
        python = ROOT / f".venv-{program}" / "bin" / "python"
        environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
        self._process = subprocess.Popen(
            [str(python), "-m", "tools.fuzz.worker", program],
            cwd=ROOT,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def execute(
        self, words: list[str], folder: Path, limit: float, kill_after: float | None = None
    ) -> dict[str, Any]:
        """Execute a command in a folder.

        Returns
        -------
        dict
            ``code`` (negative: a signal), ``seconds``, ``ended`` ("itself", "killed", "hang"),
            ``stdout`` and ``stderr``.
        """
        request = {"words": words, "folder": str(folder), "limit": limit, "kill": kill_after}
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        answer: dict[str, Any] = json.loads(self._process.stdout.readline())
        for name in ("stdout", "stderr"):
            path = folder / f".{name}"
            written = path.is_file()  # not by a process that is killed before it opens them
            answer[name] = path.read_text(errors="replace") if written else ""
            path.unlink(missing_ok=True)
        return answer

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


def serve(program: str) -> None:
    """Answer requests until standard input ends."""
    for name in PRELOADED[program]:
        importlib.import_module(name)
    main = importlib.import_module(f"{program}.command_line").main
    for line in sys.stdin:
        request = json.loads(line)
        began = time.monotonic()
        child = os.fork()
        if child == 0:
            _work(main, request)
        code, ended = _wait(child, request["limit"], request["kill"])
        answer = {"code": code, "seconds": time.monotonic() - began, "ended": ended}
        print(json.dumps(answer), flush=True)


def _work(main: Any, request: dict[str, Any]) -> None:
    """Do what the program's console script does, and end this process."""
    os.setsid()
    os.chdir(request["folder"])
    for number, name in ((0, os.devnull), (1, ".stdout"), (2, ".stderr")):
        file = os.open(name, os.O_RDWR | os.O_CREAT | os.O_TRUNC if number else os.O_RDONLY, 0o644)
        os.dup2(file, number)
        os.close(file)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    code = 1
    try:
        code = main(request["words"])
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _wait(child: int, limit: float, kill_after: float | None) -> tuple[int, str]:
    """Wait for a process group's leader; kill the group at the given time, or at the limit."""
    began = time.monotonic()
    end = limit if kill_after is None else min(limit, kill_after)
    while True:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return os.waitstatus_to_exitcode(status), "itself"
        if time.monotonic() - began > end:
            os.killpg(child, signal.SIGKILL)
            _, status = os.waitpid(child, 0)
            return os.waitstatus_to_exitcode(status), "hang" if end == limit else "killed"
        time.sleep(POLL)


if __name__ == "__main__":
    serve(sys.argv[1])
