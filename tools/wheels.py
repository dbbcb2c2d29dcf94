"""Build the wheels of the three distributions: ``python -m tools.wheels [FOLDER]``.

It needs `build` (``pip install build``), and npm where the page's bundle is missing or older than
its sources. Wheels are built from copies, so that nothing is left among the sources, and each has
the licence.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
PARTS = ("shared_schema", "datagen", "surrogate")
LEFT_OUT = shutil.ignore_patterns("__pycache__", "*.egg-info", "node_modules", "build")


def build(out: Path, *options: str) -> None:
    """Build all wheels into a folder, with further options of `build`."""
    with TemporaryDirectory() as folder:
        for part in PARTS:
            copy = Path(folder) / part
            shutil.copytree(ROOT / part, copy, ignore=LEFT_OUT)
            shutil.copy(ROOT / "LICENSE", copy)
            words = ["--wheel", "--outdir", str(out), str(copy), *options]
            command = [sys.executable, "-m", "build", *words]
            done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            if done.returncode:
                raise SystemExit(f"{part}: no wheel\n{done.stdout.decode(errors='replace')}")
        print(f"{out}: wheels of {', '.join(PARTS)}")


if __name__ == "__main__":
    build(Path(*sys.argv[1:2] or ["dist"]).absolute())
