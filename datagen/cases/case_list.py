"""The table of the cases that come with the package."""

from __future__ import annotations

from typing import Any

from datagen.cases.case import SHIPPED
from shared_schema.common.shipped_files import shipped_files
from shared_schema.common.text_table import laid_out


def case_list() -> str:
    """Lay out name, mesh, load family, number of samples and one line of every shipped case."""
    rows = [("case", "mesh", "load", "samples", "")]
    for name, content, line in shipped_files(SHIPPED):
        samples = str(content["dataset"]["samples"])
        rows.append((name, _mesh(content["mesh"]), _load(content["load"]), samples, line))
    return laid_out(rows)


def _load(load: Any) -> str:
    """Name the load families of a case."""
    return " + ".join(each["family"] for each in (load if isinstance(load, list) else [load]))


def _mesh(mesh: dict[str, Any]) -> str:
    """Describe a mesh in few words: elements of a box, or the file."""
    if mesh["kind"] == "box":
        return " × ".join(map(str, mesh["elements"]))
    return str(mesh.get("path", mesh["kind"]))
