"""Time the way from wheels to the page of a kidney: ``python -m tools.fresh_install [DIST]``.

In a new environment of the Python that runs this, pip installs the wheels of the folder DIST (made
by `python -m tools.wheels`), and `surrogate touch` leads from a surface to its page of 3000 nodes,
with no other program on the path. The user need not be root. To time it without the download, let
`pip download -d DIST` put what they need beside them, and set PIP_NO_INDEX=1.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
import venv
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
PARTS = "solid-datagen[mesh]", "solid-surrogate"
KIDNEY = ("--support", "x<-0.035", "--young-modulus", "5000", "--size", "0.0033", "--no-browser")


def main(dist: Path) -> None:
    """Install and touch, and print what each takes."""
    with TemporaryDirectory() as folder:
        place = Path(folder) / "environment"
        venv.create(place, with_pip=True)
        programs = place / ("Scripts" if os.name == "nt" else "bin")
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "NUMBA"))}

        def run(what: str, program: str, *words: str | Path) -> None:
            began = time.perf_counter()
            command = [str(programs / program), *map(str, words)]
            environment = {**kept, "PATH": str(programs)}
            subprocess.run(command, cwd=folder, env=environment, check=True)
            print(f"{what}: {time.perf_counter() - began:.1f} s", flush=True)

        run("pip install", "python", "-m", "pip", "install", "-q", "--find-links", dist, *PARTS)
        code = f"import sys; sys.path.append({str(ROOT)!r}); from tools.kidney import kidney; "
        code += "from pathlib import Path; kidney(Path('kidney.stl'))"
        run("surface", "python", "-c", code)
        for when in ("first", "again"):
            run(f"page, {when}", "surrogate", "touch", "kidney.stl", *KIDNEY, "--out", when)


if __name__ == "__main__":
    main(Path(*sys.argv[1:2] or ["dist"]).absolute())
