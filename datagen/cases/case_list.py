"""The cases that come with the package."""

from __future__ import annotations

from typing import Any, NamedTuple

from datagen.cases.case import SHIPPED
from shared_schema.common.configuration import shipped_files


class ShippedCase(NamedTuple):
    """What one line says of a case.

    Attributes
    ----------
    name : str
    mesh : str
        Elements of a box, or the file.
    load : str
        Names of its load families.
    samples : int
    line : str
        What the case is.
    """

    name: str
    mesh: str
    load: str
    samples: int
    line: str


def shipped_cases() -> list[ShippedCase]:
    """List the cases that come with the package, by name."""
    return [
        ShippedCase(
            name, _mesh(case["mesh"]), _load(case["load"]), case["dataset"]["samples"], line
        )
        for name, case, line in shipped_files(SHIPPED)
    ]


def _load(load: Any) -> str:
    """Name the load families of a case."""
    return " + ".join(each["family"] for each in (load if isinstance(load, list) else [load]))


def _mesh(mesh: dict[str, Any]) -> str:
    """Describe a mesh in few words: elements of a box, or the file."""
    if mesh["kind"] == "box":
        return " × ".join(map(str, mesh["elements"]))
    return str(mesh.get("path", mesh["kind"]))
