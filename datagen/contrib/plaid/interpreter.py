"""The Python that has pyplaid: this one, or that of an environment of its own."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

from shared_schema.common.errors import InputError, WorkError

MODULE = "plaid"
UNFIT = 3  # exit code of a script that says what is wrong with its input


def require_interpreter(python: Path | str | None) -> str:
    """Return the path of a Python that can import pyplaid.

    Parameters
    ----------
    python : Path or str, optional
        Interpreter of another environment; by default this one.

    Raises
    ------
    InputError
        If it is no Python, or has no pyplaid.
    """
    hint = "`python3 -m venv plaid && plaid/bin/pip install pyplaid` makes an environment"
    if python is None:
        if importlib.util.find_spec(MODULE) is None:
            raise InputError(
                f"--python: pyplaid is not installed here; {hint}, --python plaid/bin/python "
                "names it"
            )
        return sys.executable
    check = f"import importlib.util, sys; sys.exit(importlib.util.find_spec({MODULE!r}) is None)"
    try:
        done = subprocess.run([python, "-I", "-c", check], capture_output=True, check=False)
    except OSError as error:
        raise InputError(f"--python '{python}': cannot be run ({error.strerror})") from None
    if done.returncode != 0:
        raise InputError(f"--python '{python}': has no pyplaid; {hint}")
    return str(python)


def run_script(python: str, name: str, *arguments: Path | str) -> None:
    """Run a script of this package, which imports pyplaid and nothing of this project.

    Raises
    ------
    InputError
        If the script says that its input does not fit.
    WorkError
        If it ends with an error.
    """
    script = Path(__file__).with_name(name)
    done = subprocess.run(
        [python, "-I", str(script), *map(str, arguments)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    if done.returncode == UNFIT:
        raise InputError(done.stdout.strip())
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise WorkError(f"pyplaid ended with exit code {done.returncode}: {last}")
