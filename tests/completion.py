"""What bash would offer for the last word of a command line."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

DRIVER = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(( $# - 1 )); COMP_LINE="$*"; COMPREPLY=()
"_shtab_$1"
printf '%s\\n' "${COMPREPLY[@]}"
"""


def offered(script: Path, *words: str) -> list[str]:
    """Complete the last of some words by a completion script."""
    done = subprocess.run(
        ["bash", "-c", DRIVER, "bash", str(script), *words],
        capture_output=True,
        text=True,
        check=True,
        cwd=script.parent,
    )
    assert done.stderr == ""
    return done.stdout.split()


def write_script(
    main: Callable[[Sequence[str]], int], path: Path, capsys: pytest.CaptureFixture[str]
) -> Path:
    """Write the completion script that a program prints for bash."""
    with pytest.raises(SystemExit) as end:
        main(["--print-completion", "bash"])
    assert end.value.code == 0
    path.write_text(capsys.readouterr().out)
    return path
