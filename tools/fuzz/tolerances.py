"""Soft bodies under loads near instability: a tolerance that counts as reached is kept.

The factory goes on from what is predicted to the equilibrium there.
"""

from __future__ import annotations

from pathlib import Path
from random import Random

import yaml

from tools.fuzz.attacks import Outcome
from tools.fuzz.material import Material
from tools.fuzz.steps import Steps, apart

TOLERANCE = 5e-3
MATERIALS = (
    {"young_modulus": 500.0, "poisson_ratio": 0.3},
    {"young_modulus": 500.0, "poisson_ratio": 0.45},
    {"model": "yeoh", "c10": 80.0, "c20": 10.0, "c30": 5.0, "bulk_modulus": 400.0},
    {"model": "mooney_rivlin", "c10": 60.0, "c01": 20.0, "bulk_modulus": 400.0},
)


def soft(random: Random, material: Material, folder: Path) -> Outcome:
    """Press on slender bodies along their axis, across, and on an arch's top."""
    steps = Steps(material, folder)
    change, loads = write_body(folder, random)
    load = [word for text in loads for word in ("--load", text)]
    change += " under " + " ".join(loads)
    kept = ["--tolerance", repr(TOLERANCE)]
    for program, words in (
        ("datagen", ["body", "soft.yaml", "--out", "body"]),
        ("surrogate", ["train", "series", "--data", "body", "--out", "run"]),
    ):
        if not steps.take(program, *words):
            return steps.ended(words[0], change)
    words = ["predict", "run", *load, "--nearest", *kept, "--out", "p.npz"]
    if not steps.take("surrogate", *words, codes=(0, 3)) or steps.answer["code"] == 3:
        return steps.ended("predict --tolerance", change)
    more = ["--nearest", "--start", "p.npz", "--out", "s.npz"]
    if not steps.take("datagen", "solve", "soft.yaml", *load, *more):
        return steps.ended("solve --start", change)
    wrong = apart(steps.field("p.npz"), steps.field("s.npz"))
    finding = f"within {TOLERANCE}, off by {wrong:.2g}" if wrong > TOLERANCE else ""
    return steps.ended("predict --tolerance", change, finding)


def write_body(folder: Path, random: Random) -> tuple[str, list[str]]:
    """Write ``soft.yaml``: a slender box, held at one end or both; return a description, loads."""
    space, both = random.random() < 0.3, random.random() < 0.4
    length = random.uniform(3.0, 10.0)
    elements = [random.randint(8, 14), random.randint(1, 3)] + [1] * space
    model = random.choice(MATERIALS)
    ends = [{"x": 0.0}, *([{"x": length}] if both else [])]
    case = {
        "name": "soft",
        "mesh": {
            "kind": "box",
            "lower": [0.0] * len(elements),
            "upper": [length, *[1.0] * (len(elements) - 1)],
            "elements": elements,
        },
        "element": random.choice(("linear", "quadratic", "incompressible")),
        "material": model,
        "supports": ends,
        "load": {"family": "random_node", "range": [-1, 1]},
        "dataset": {"samples": 8, "seed": 1},
    }
    (folder / "soft.yaml").write_text(yaml.safe_dump(case))
    buckling = 9.87 * 500.0 / 12 / (4 * length**2)  # Euler's, of a cantilever
    axial = buckling * 10 ** random.uniform(-0.5, 1.0)
    place = length / 2 if both else length
    across = axial * random.choice((0.0, 1e-4, 1e-2, 1.0)) * random.choice((-1, 1))
    loads = []
    for y in (0.0, 1.0):
        for z in (0.0, 1.0)[: 1 + space]:
            share = 2 * (1 + space)
            at = ",".join(repr(v) for v in (place, y, z)[: 2 + space])
            force = (-axial / share, across / share, 0.0)[: 2 + space]
            loads.append(f"{at}:{','.join(repr(v) for v in force)}")
    cells = "x".join(map(str, elements))
    return f"{case['element']} {model.get('model', 'neo_hookean')} {cells}", loads
