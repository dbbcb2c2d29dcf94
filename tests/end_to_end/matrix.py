"""The matrix of what the learner computes: materials × elements × loads × methods, on one body.

The body is a plane bar of 4 × 1 m in two halves, of triangles. `test_matrix` compares every field
with the equilibrium that `datagen` finds. What is not right yet stands in `OPEN`: the test of such
a field fails as soon as the field is right, and the entry is then to be taken out. What cannot be
for a reason of physics stands in `REASONS`, with a part of the line that says so.

``python -m tests.end_to_end.matrix`` prints the table of ``docs/limitations.md``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

BODIES = Path(__file__).parent / "bodies"
ELEMENTS = ("linear", "quadratic", "incompressible")
NEO_HOOKE = {"young_modulus": 500, "poisson_ratio": 0.4}
GENT = {"model": "gent", "shear_modulus": 180, "limit": 20, "bulk_modulus": 900}
MATERIALS: dict[str, Any] = {
    "Neo-Hooke": NEO_HOOKE,
    "Yeoh": {"model": "yeoh", "c10": 90, "c20": -2, "c30": 0.1, "bulk_modulus": 900},
    "Mooney–Rivlin": {"model": "mooney_rivlin", "c10": 60, "c01": 30, "bulk_modulus": 900},
    "Gent": GENT,
    "one's own": {
        "model": f"{BODIES / 'own_energy.py'}:Fung",
        "shear": 180,
        "bulk": 900,
        "stiffening": 0.5,
    },
    "two materials": [{"group": "left", **NEO_HOOKE}, {"group": "right", **GENT}],
}
# The families that cases draw, and the loads of the fields as `--load` takes them; in N, Pa.
FORCE = {"family": "random_nodes", "region": {"boundary": True, "x": "> 0"}, "range": [-3, 3]}
LOADS: dict[str, list[dict[str, Any]]] = {
    "dead force": [{**FORCE, "count": [1, 2]}],
    "body force": [{"family": "body_force", "range": [-2, 2]}],
    "traction": [{"family": "traction_patch", "range": [-4, 4], "radius": 1}],
    "following pressure": [
        {**FORCE, "count": [1, 2]},
        {"family": "pressure", "region": {"group": "top"}, "range": [0, 1.5]},
    ],
}
ACTING: dict[str, dict[str, Any]] = {
    "dead force": {"load": ["4,1:1,-2"]},
    "body force": {"body_force": "0,-1"},
    "traction": {"load": ["3,1,1:1,-3"]},
    "following pressure": {"load": ["top:1"]},
}
DEAD, PRESSURE = "dead force", "following pressure"
BESIDE = ("hold", "tool", "identify")  # alone, and beside a pressure
OF_RUNS = ("page", "export")  # files for any dead load, and for pressures
# Bodies whose runs are exported, which takes long; a file takes no pressure, also of such a run.
EXPORTED = (
    ("one's own", "quadratic", DEAD),
    ("two materials", "incompressible", DEAD),
    ("one's own", "linear", PRESSURE),
)
HELD, TOOL = "4,1:-0.05,-0.3", "sphere:3,1.1:0.4"
METHODS = {
    "series": "five terms of the load series, without `--tolerance`",
    "directions": "`--tolerance`",
    "fast": "`calibrate`, `--certify fast`",
    "full": "`--certify full`",
    "correct": "`--correct`",
    "stresses": "`--stresses`",
    "page": "`page`",
    "export": "`export`",
    "hold": "`--hold`",
    "tool": "`--tool`",
    "identify": "`identify`: a force",
}


@dataclass(frozen=True)
class Field:
    """A field of the matrix.

    Attributes
    ----------
    material, element, load, method : str
        Of `MATERIALS`, `ELEMENTS`, `LOADS` and `METHODS`. A held place, a tool, and a force that is
        sought act alone, or beside the pressure.
    """

    material: str
    element: str
    load: str
    method: str

    @property
    def body(self) -> tuple[str, str, str]:
        """Material, element and load of the case."""
        return self.material, self.element, self.load

    def __str__(self) -> str:
        """Name of the field."""
        return f"{self.method}: {self.load}, {self.element}, {self.material}"


@dataclass(frozen=True)
class Fields:
    """Some fields of the matrix; an axis that is empty stands for all of it.

    Attributes
    ----------
    why : str
        What is missing, or the reason of physics.
    methods, loads, elements, materials : tuple of str
    """

    why: str
    methods: tuple[str, ...] = ()
    loads: tuple[str, ...] = ()
    elements: tuple[str, ...] = ()
    materials: tuple[str, ...] = ()

    def __str__(self) -> str:
        """A line that names the fields and says why."""
        axes = (*(METHODS[name] for name in self.methods), *self.loads, *self.elements)
        return f"{', '.join((*axes, *self.materials))}: {self.why}"

    def __contains__(self, field: Field) -> bool:
        """Whether a field is one of these."""
        asked = (
            (field.method, self.methods),
            (field.load, self.loads),
            (field.element, self.elements),
            (field.material, self.materials),
        )
        return all(not allowed or value in allowed for value, allowed in asked)


def loads_of(method: str) -> tuple[str, ...]:
    """Loads with which a method makes a field."""
    return (DEAD, PRESSURE) if method in (*BESIDE, *OF_RUNS) else tuple(LOADS)


def fields() -> Iterator[Field]:
    """All fields."""
    for material, element in product(MATERIALS, ELEMENTS):
        for method in METHODS:
            for load in loads_of(method):
                if method != "export" or (material, element, load) in EXPORTED:
                    yield Field(material, element, load, method)


def found_in(listed: tuple[Fields, ...], field: Field) -> str | None:
    """Why a field is listed; None if it is not."""
    return next((some.why for some in listed if field in some), None)


BETWEEN = ("quadratic", "incompressible")
REASONS: tuple[Fields, ...] = ()
OPEN: tuple[Fields, ...] = ()


def table() -> str:
    """The matrix in Markdown: how many bodies are right, and what the others lack."""
    rows = ["| | " + " | ".join(LOADS) + " |", "|---|" + "---|" * len(LOADS)]
    for method, option in METHODS.items():
        cells = [_share(method, load) if load in loads_of(method) else "" for load in LOADS]
        rows.append(f"| {option} | " + " | ".join(cells) + " |")
    rows.append("")
    for title, listed in (("No number, by physics", REASONS), ("Not yet", OPEN)):
        if listed:
            rows += [f"{title}:", "", *(f"- {some}" for some in listed), ""]
    return "\n".join(rows).rstrip() + "\n"


def _share(method: str, load: str) -> str:
    """Number of bodies of a method and a load that are right."""
    asked = [field for field in fields() if (field.method, field.load) == (method, load)]
    right = sum(found_in((*REASONS, *OPEN), field) is None for field in asked)
    return "all" if right == len(asked) else f"{right} of {len(asked)}"


def case_of(material: str, element: str, load: str) -> dict[str, Any]:
    """Content of the case file of a body."""
    return {
        "name": "bar",
        "mesh": {"kind": "file", "path": str(BODIES / "two_halves.geo")},
        "material": MATERIALS[material],
        "element": element,
        "supports": [{"x": 0}],
        "load": LOADS[load],
        "dataset": {"samples": 20, "seed": 1},
    }


if __name__ == "__main__":
    print(table(), end="")
