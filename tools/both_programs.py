"""Run a Python script that imports `datagen` and `surrogate`: both_programs.py SCRIPT.

It is run by the interpreter of `datagen`. Debian's dolfinx needs Debian's NumPy, so the packages of
`surrogate` come last; but PyTorch needs a newer sympy than Debian's, which is therefore loaded
first. PyTorch follows, before PETSc: later, it would take functions of OpenBLAS for its own of the
same names, and end in a segmentation fault (OpenBLAS 0.3.29, Debian 13). In an environment that has
dolfinx and PyTorch, such a script runs as it is.
"""

from __future__ import annotations

import importlib
import runpy
import site
import sys
from pathlib import Path

LEARNER = Path(__file__).parents[1] / ".venv-surrogate"


def main(script: str) -> None:
    """Run a script."""
    (packages,) = map(str, LEARNER.glob("lib/python3*/site-packages"))
    sys.path.insert(0, packages)
    importlib.import_module("sympy")
    sys.path.remove(packages)
    site.addsitedir(packages)
    importlib.import_module("torch")
    runpy.run_path(script, run_name="__main__")


if __name__ == "__main__":
    main(sys.argv[1])
