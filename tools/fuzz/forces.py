"""Distributed loads beside closed forms: a bar in tension or under pressure, a column in gravity.

The surface x = 0 slides in its plane. A uniform traction or pressure on the opposite end deforms
the bar homogeneously, with every cell and element. A column whose sides slide as well has, under a
body force b along it, the displacement b (L x − x²/2) / M, where M is the modulus of uniaxial
strain; cells with points between their nodes, quadrilaterals and hexahedra have it at all nodes.
"""

from __future__ import annotations

from pathlib import Path
from random import Random

import numpy as np
import yaml

from tools.fuzz.attacks import Outcome
from tools.fuzz.material import Material
from tools.fuzz.steps import Steps, apart

HOMOGENEOUS, LINEAR = 1e-7, 2e-3  # deviations, as a part of the largest displacement
SAME = 1e-6  # of the learner's equilibrium and the factory's
YOUNG = 500.0  # Pa
SCRIPT = """
Point(1) = {{0, 0, 0}}; Point(2) = {{{length}, 0, 0}};
Point(3) = {{{length}, 1, 0}}; Point(4) = {{0, 1, 0}};
Line(1) = {{1, 2}}; Line(2) = {{2, 3}}; Line(3) = {{3, 4}}; Line(4) = {{4, 1}};
Curve Loop(1) = {{1, 2, 3, 4}}; Plane Surface(1) = {{1}};
Transfinite Curve {{1, 3}} = {along}; Transfinite Curve {{2, 4}} = {across};
Transfinite Surface {{1}};
"""
BLOCKS = "Recombine Surface {1};\n"
PLANE = 'Physical Surface("body") = {1}; Physical Curve("end") = {2};\n'
SPACE = """solid[] = Extrude {{0, 0, 1}} {{ Surface{{1}}; Layers{{2}}; {recombined} }};
Physical Volume("body") = {{solid[1]}}; Physical Surface("end") = {{solid[3]}};
"""


def write_bar(folder: Path, random: Random, kind: str) -> str:
    """Write ``bar.geo`` and ``bar.yaml``, of any cells and element; return a description."""
    column, family = kind == "body force", "pressure" if kind == "pressure" else "random_node"
    space, blocks = random.random() < 0.5, random.random() < 0.5
    element = random.choice(("linear", "quadratic", "incompressible"))
    length, ratio = random.uniform(1.0, 3.0), random.choice((0.0, 0.3, 0.45))
    script = SCRIPT.format(length=length, along=random.randint(3, 5), across=random.randint(2, 3))
    script += BLOCKS if blocks else ""
    script += SPACE.format(recombined="Recombine;" if blocks else "") if space else PLANE
    (folder / "bar.geo").write_text(script)
    sides = [{"x": 0, "components": ["x"]}, {"y": 0, "components": ["y"]}]
    sides += [{"y": 1, "components": ["y"]}] if column else []
    if space:
        sides += [{"z": 0, "components": ["z"]}]
        sides += [{"z": 1, "components": ["z"]}] if column else []
    case = {
        "name": "bar",
        "mesh": {"kind": "file", "path": "bar.geo"},
        "element": element,
        "material": {"young_modulus": YOUNG, "poisson_ratio": ratio},
        "supports": sides,
        "load": {"family": family, "region": {"group": "end"}, "range": [-1, 1]},
        "dataset": {"samples": 8, "seed": 1},
    }
    (folder / "bar.yaml").write_text(yaml.safe_dump(case))
    cells = ("hexahedra" if blocks else "tetrahedra") if space else ("quads" if blocks else "tri")
    return f"{element} {cells}, ν = {ratio}, {length:.3g} m"


def distributed(random: Random, material: Material, folder: Path) -> Outcome:
    """Pull, press or hang a bar: closed forms in the factory, the same in the learner."""
    kind = random.choice(("traction", "pressure", "body force"))
    steps = Steps(material, folder)
    change = f"{kind} on {write_bar(folder, random, kind)}"
    case = yaml.safe_load((folder / "bar.yaml").read_text())
    d = 3 if any("z" in side for side in case["supports"]) else 2
    size = random.choice((-1, 1)) * YOUNG * (1e-3 if kind == "body force" else 0.1)
    along = ",".join(repr(v) for v in (size, *[0.0] * (d - 1)))
    load = {
        "traction": ["--load", f"end:{along}"],  # of an end of 1 m²
        "pressure": ["--load", f"end:{size!r}"],
        "body force": ["--body-force", along],
    }[kind]
    if not steps.take("datagen", "solve", "bar.yaml", *load, "--out", "s.npz"):
        return steps.ended("solve", change)
    x, u = steps.field("s.npz", "coordinates"), steps.field("s.npz")
    if kind == "body force":
        if case["element"] != "linear" or "hexahedra" in change or "quads" in change:
            wrong = apart(u, hanging(x, size, case["material"]["poisson_ratio"]))
            if wrong > LINEAR:
                return steps.ended("solve", change, f"{wrong:.2g} from the closed form")
    else:
        wrong = apart(u, homogeneous(x, u))
        if wrong > HOMOGENEOUS:
            return steps.ended("solve", change, f"not homogeneous, by {wrong:.2g}")
    for program, words in (
        ("datagen", ["body", "bar.yaml", "--out", "body"]),
        ("surrogate", ["train", "series", "--data", "body", "--out", "run"]),
        ("surrogate", ["predict", "run", *load, "--correct", "--out", "c.npz"]),
    ):
        if not steps.take(program, *words):
            return steps.ended(words[0], change)
    wrong = apart(steps.field("c.npz"), u)
    finding = f"corrected by {wrong:.2g} beside datagen" if wrong > SAME else ""
    return steps.ended("predict --correct", change, finding)


def homogeneous(x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Nearest homogeneous deformation of the nodes, (n, d) in m."""
    columns = np.column_stack((x, np.ones(len(x))))
    return np.asarray(columns @ np.linalg.lstsq(columns, u, rcond=None)[0])


def hanging(x: np.ndarray, force: float, ratio: float) -> np.ndarray:
    """Displacement of a column under a small body force in N/m³ along x, (n, d) in m."""
    modulus = YOUNG * (1 - ratio) / ((1 + ratio) * (1 - 2 * ratio))
    u = np.zeros(x.shape)
    u[:, 0] = force / modulus * (x[:, 0].max() * x[:, 0] - x[:, 0] ** 2 / 2)
    return u
