"""Bodies near instability: both programs are in stable equilibria, and a tolerance is kept.

Each attack states what must hold between results: the equilibrium of one program is that of the
other, or one where the other stays; what counts as within a tolerance is.
"""

from __future__ import annotations

from pathlib import Path
from random import Random

import numpy as np
import yaml

from tools.fuzz.attacks import Outcome
from tools.fuzz.material import Material
from tools.fuzz.steps import Steps, apart

SAME = 1e-5  # largest difference of equal displacements, as a part of the largest
TOLERANCE = 5e-3
MATERIALS = (
    {"young_modulus": 500.0, "poisson_ratio": 0.3},
    {"young_modulus": 500.0, "poisson_ratio": 0.45},
    {"model": "yeoh", "c10": 80.0, "c20": 10.0, "c30": 5.0, "bulk_modulus": 400.0},
    {"model": "mooney_rivlin", "c10": 60.0, "c01": 20.0, "bulk_modulus": 400.0},
)


def unstable(random: Random, material: Material, folder: Path) -> Outcome:
    """Press on the 2D beam's end: stable equilibria in both programs, no bound that is wrong.

    Under a load that is not symmetric, of several times that of buckling, the beam has more than
    one; `datagen`, started in the corrected state, must then stay there.
    """
    total = 10 ** random.uniform(0.3, 1.9)
    heights = random.sample((0.0, 1 / 3, 2 / 3, 1.0), random.randint(1, 4))
    aside = random.choice((0.0, 0.0, 1e-3, 0.05)) * total
    change = f"{total:.3g} N at {[round(y, 2) for y in heights]}, {aside:.3g} N across"
    load: list[str] = []
    for y in heights:
        load += ["--load", f"4,{y!r}:{-total / len(heights)!r},{-aside / len(heights)!r}"]
    steps = Steps(material, folder)
    words = ("predict", "beam2d_any", *load)
    if not steps.take("datagen", "solve", "beam2d", *load, "--out", "s.npz", codes=(0, 1)):
        return steps.ended("solve", change)
    if steps.answer["code"] == 1:  # the path of equilibria from rest may end before the load
        is_told = "no equilibrium found beyond" in steps.answer["stderr"]
        return steps.ended("solve", change, "" if is_told else "datagen solve: exit 1")
    if not steps.take("surrogate", *words, "--correct", "--out", "c.npz"):
        return steps.ended("predict --correct", change)
    solved, corrected = steps.field("s.npz"), steps.field("c.npz")
    mirrored = solved[mirror(steps.field("s.npz", "coordinates"))] * (1, -1)
    if min(apart(corrected, solved), apart(corrected, mirrored)) > SAME:  # one of several?
        again = "--start", "c.npz", "--out", "r.npz"
        if not steps.take("datagen", "solve", "beam2d", *load, *again):
            return steps.ended("solve --start", change)
        if apart(corrected, steps.field("r.npz")) > SAME:
            return steps.ended("predict --correct", change, "no stable equilibrium of datagen's")
    if steps.take("surrogate", *words, "--certify", "fast", "--out", "f.npz", codes=(0, 3)):
        error = np.abs(steps.field("f.npz") - corrected).max()
        error = min(error, np.abs(steps.field("f.npz") - mirrored).max())
        told = steps.field("f.npz", "estimated_error")
        if steps.answer["code"] == 0 and error > 10 * np.abs(told).max() + 1e-6:
            return steps.ended("predict --certify fast", change, f"certified, off by {error:.2g} m")
    return steps.ended("predict --certify fast", change)


def mirror(coordinates: np.ndarray) -> np.ndarray:
    """Nodes at the mirrored places of the 2D beam, y → 1 − y."""
    image = coordinates * (1, -1) + (0, 1)
    return np.asarray(np.linalg.norm(coordinates[None] - image[:, None], axis=2).argmin(axis=1))


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
