"""Commands of `datagen` that make the datasets of a scale."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator
from pathlib import Path

from experiments.framework.scale import Scale
from shared_schema import MANIFEST


def missing_data(scale: Scale, data: Path) -> Iterator[str]:
    """Yield the commands that make the missing datasets of a scale, in order.

    The commands are lines for a shell; its variable ``MPIRUN`` may hold the launcher of ranks.

    Parameters
    ----------
    scale : Scale
    data : Path
        Folder of the datasets: `data`/NAME/nodal and `data`/NAME/structured.
    """
    for name, spec in scale.datasets.items():
        folder = data / scale.folder_of(name)
        nodal, structured = folder / "nodal", folder / "structured"
        commands = []
        if spec.case:
            samples = ("--samples", spec.samples) if spec.samples else ()
            changes = [f"--set={key}={json.dumps(value)}" for key, value in spec.change.items()]
            command = shell_line("run", spec.case, *changes, "--out", nodal, *samples)
            commands.append((nodal, f"${{MPIRUN-}} {command}"))
        else:
            source = data / scale.folder_of(str(spec.of)) / "nodal"
            if spec.noise:
                commands.append((nodal, shell_line("noise", source, "--out", nodal)))
            else:
                nodal = source
        if spec.grid:
            order = () if spec.order == "preferred" else ("--order", spec.order)
            row = ("--grid", "nodes") if spec.grid == "nodes" else ()
            commands.append(
                (structured, shell_line("structure", nodal, "--out", structured, *order, *row))
            )
        missing = [command for made, command in commands if not (made / MANIFEST).is_file()]
        if missing:
            yield f"mkdir -p {shlex.quote(str(folder))}"
            yield from missing


def shell_line(*words: object) -> str:
    """Command of `datagen` with its words quoted for a shell."""
    return f"datagen {shlex.join(str(word) for word in words)}"
