"""A plane body of 4 × 1 m in two halves, of any material and element, by both programs."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from tests.end_to_end.commands import DATAGEN, ENVIRONMENT, SURROGATE, execute

MESH = """
Point(1) = {0, 0, 0}; Point(2) = {2, 0, 0}; Point(3) = {4, 0, 0};
Point(4) = {4, 1, 0}; Point(5) = {2, 1, 0}; Point(6) = {0, 1, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 5}; Line(5) = {5, 6};
Line(6) = {6, 1}; Line(7) = {2, 5};
Curve Loop(1) = {1, 7, 5, 6}; Plane Surface(1) = {1};
Curve Loop(2) = {2, 3, 4, -7}; Plane Surface(2) = {2};
Transfinite Curve{1, 2, 4, 5} = 6; Transfinite Curve{3, 6, 7} = 4;
Transfinite Surface{1, 2};
Physical Curve("clamped") = {6}; Physical Curve("upper") = {4, 5}; Physical Curve("end") = {3};
Physical Surface("root") = {1}; Physical Surface("tip") = {2};
"""
SOFT = {"young_modulus": 500, "poisson_ratio": 0.45}
YEOH = {"model": "yeoh", "c10": 90, "c20": -2, "c30": 0.1, "bulk_modulus": 2000}
MATERIALS: dict[str, Any] = {
    "neo-hooke": SOFT,
    "yeoh": YEOH,
    "mooney-rivlin": {"model": "mooney_rivlin", "c10": 60, "c01": 25, "bulk_modulus": 2000},
    "gent": {"model": "gent", "shear_modulus": 170, "limit": 40, "bulk_modulus": 2000},
    "both": [{**SOFT, "group": "root"}, {**YEOH, "group": "tip"}],
}
FORCE = {"family": "random_node", "region": {"x": "> 3"}, "range": [-4, 4]}
PRESSURE = {"family": "pressure", "region": {"group": "upper"}, "range": [-3, 3]}
ALL_AT_ONCE = """
import json, sys
from datagen.command_line import main
for words in json.load(sys.stdin):
    assert main(words) == 0, words
"""


def by_factory(commands: Sequence[Sequence[str | Path]]) -> None:
    """Run commands of `datagen` in one process, which imports its libraries once."""
    python = DATAGEN.with_name("python")
    words = json.dumps([list(map(str, command)) for command in commands])
    subprocess.run([python, "-c", ALL_AT_ONCE], input=words, env=ENVIRONMENT, text=True, check=True)


def case_of(folder: Path, material: str, element: str, load: str) -> Path:
    """Write the case of a body under a force or a pressure, with its mesh; return the file."""
    (folder / "halves.geo").write_text(MESH)
    case = {
        "name": f"{material}-{element}-{load}",
        "mesh": {"kind": "file", "path": "halves.geo"},
        "material": MATERIALS[material],
        "element": element,
        "supports": [{"group": "clamped"}],
        "load": FORCE if load == "force" else PRESSURE,
        "dataset": {"samples": 1, "seed": 1},
    }
    path = folder / f"{case['name']}.yaml"
    path.write_text(yaml.safe_dump(case))
    return path


def series_of(body: Path) -> Path:
    """Make the load series of a body of `datagen body`; return its run folder."""
    run = body.with_name(f"{body.name}-run")
    execute(SURROGATE, "train", "series", "--data", body, "--out", run)
    return run
