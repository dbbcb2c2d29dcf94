"""Files that meshio reads, with the reason where it reads none."""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from shared_schema.common.errors import first_line


def read_by_meshio(path: Path) -> Any:
    """Read a file: a ``meshio.Mesh``.

    Raises
    ------
    ValueError
        If meshio cannot read it, with the reason, which meshio prints before it exits.
    """
    import meshio

    said = io.StringIO()
    try:
        # what meshio tries of a text file may be no number
        with np.errstate(over="ignore"), redirect_stdout(said), redirect_stderr(io.StringIO()):
            return meshio.read(path)
    except (Exception, SystemExit) as error:
        name = "" if isinstance(error, (ValueError, SystemExit)) else f"{type(error).__name__}: "
        reason = " ".join(said.getvalue().split()) or name + first_line(error)
        if isinstance(error, SystemExit) and not said.getvalue().strip():
            reason = "not a file of the format that its name says"
        raise ValueError(reason) from None
