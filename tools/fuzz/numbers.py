"""Attacks by mechanics: unstable loads, scaled bodies, meshes that are none, supports, pressures.

Each states what must hold between results: both programs find one equilibrium, a body of another
size or stiffness deforms alike, held components stay zero, a mesh that is none is refused.
"""

from __future__ import annotations

from pathlib import Path
from random import Random

import numpy as np
import yaml

from tools.fuzz.attacks import Attack, Outcome
from tools.fuzz.forces import distributed
from tools.fuzz.foreign_meshes import foreign_mesh
from tools.fuzz.material import Material
from tools.fuzz.meshes import BROKEN, write_plate
from tools.fuzz.steps import Steps, apart
from tools.fuzz.tolerances import soft
from tools.fuzz.worker import ROOT

SAME = 1e-5  # largest difference of equal displacements, as a part of the largest
MODELS = ("det", "mle", "vb")


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


def scaled(random: Random, material: Material, folder: Path) -> Outcome:
    """Another size and stiffness: displacements in proportion to the size."""
    size, stiffness = (10 ** random.uniform(-6, 6) for _ in range(2))
    change = f"lengths times {size:.3g}, stiffness times {stiffness:.3g}"
    x, y = random.choice((1.0667, 2.1333, 4.0)), 1.0
    force = np.array([random.uniform(-1, 1), random.uniform(-1, 1)])
    x = float(np.linspace(0, 4, 16)[np.abs(np.linspace(0, 4, 16) - x).argmin()])
    steps = Steps(material, folder)
    for name, length, factor in (("one", 1.0, 1.0), ("other", size, stiffness)):
        case = yaml.safe_load((material.folder / "case.yaml").read_text())
        case["mesh"] |= {"upper": [4 * length, length]}
        case["material"]["young_modulus"] *= factor
        case["load"]["region"]["y"] = length
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(case))
        fx, fy = force * length * factor
        load = f"{x * length!r},{y * length!r}:{float(fx)!r},{float(fy)!r}"
        if not steps.take(
            "datagen", "solve", f"{name}.yaml", "--load", load, "--out", f"{name}.npz"
        ):
            return steps.ended("solve", change)
    difference = apart(steps.field("other.npz") / size, steps.field("one.npz"))
    wrong = f"deforms otherwise, by {difference:.2g}" if difference > SAME else ""
    return steps.ended("solve", change, wrong)


def broken_mesh(random: Random, material: Material, folder: Path) -> Outcome:
    """Give a mesh that is none, or one that is fine in another order."""
    kind = random.choice(list(BROKEN))
    steps = Steps(material, folder)
    write_plate(folder / "plate.vtk", random, kind)
    case = yaml.safe_load((material.folder / "case.yaml").read_text())
    case["mesh"] = {"kind": "file", "path": "plate.vtk"}
    case["load"] = {"family": "random_node", "region": {"x": "> 0"}, "range": [-1, 1]}
    (folder / "case.yaml").write_text(yaml.safe_dump(case))
    fine = BROKEN[kind]
    steps.take("datagen", "run", "case.yaml", "--samples", "2", "--out", "nodal", codes=(0, 2))
    finding = ""
    if steps.answer["code"] != (0 if fine else 2):
        finding = "a mesh is refused" if fine else "a mesh that is none is taken"
    elif not fine and (folder / "nodal").exists():
        finding = "wrong input left nodal"
    return steps.ended("run", kind, finding)


def small_surrogate(random: Random, material: Material, folder: Path) -> Outcome:
    """Train on a body with supports of single components, its own grid or an embedded one."""
    model, embedded = random.choice(MODELS), random.random() < 0.5
    steps = Steps(material, folder)
    case = yaml.safe_load((material.folder / "case.yaml").read_text())
    sides = [({"x": 0}, "x"), ({"y": 0}, "y")]
    if random.random() < 0.5:
        sides = [({"x": 0}, "x"), ({"x": 0, "y": 0}, "y"), ({"x": 4}, "y")]
    case["supports"] = [{**region, "components": [axis]} for region, axis in sides]
    case["load"] = {"family": "random_node", "region": {"y": 1}, "range": [-0.5, 0.5]}
    case["dataset"]["seed"] = random.randrange(1000)
    (folder / "case.yaml").write_text(yaml.safe_dump(case))
    config = yaml.safe_load((ROOT / f"surrogate/configs/{model}-fast.yaml").read_text())
    trained = yaml.safe_load((material.folder / "config.yaml").read_text())
    config |= {"name": "fuzz", "case": "beam2d"}
    config["network"] |= {"levels": 2, "channels": 2}
    config["training"] |= {k: v for k, v in trained["training"].items() if k != "loss"}
    config.pop("ensemble", None)
    config["network"].pop("force_transforms", None)
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    grid = ["--grid", f"{random.randint(4, 12)},{random.randint(3, 6)}"] if embedded else []
    change = f"{model}, {len(sides)} supports, {' '.join(grid) or 'own grid'}"
    load, few = ["--load", f"{32 / 15!r},1:0.1,-0.2"], ["--passes", "5"] if model == "vb" else []
    for program, words in (
        ("datagen", ["run", "case.yaml", "--out", "nodal"]),
        ("datagen", ["structure", "nodal", "--out", "structured", *grid]),
        ("surrogate", ["train", "config.yaml", "--data", "structured", "--out", "run"]),
        ("surrogate", ["predict", "run", *load, *few, "--out", "p.npz"]),
        ("surrogate", ["predict", "run", *load, *few, "--correct", "--out", "c.npz"]),
        ("datagen", ["solve", "case.yaml", *load, "--out", "s.npz"]),
    ):
        if not steps.take(program, *words, codes=(0, 3) if "p.npz" in words else (0,)):
            return steps.ended(words[0], change)
    u, x = steps.field("p.npz"), steps.field("p.npz", "coordinates")
    finding = "" if np.isfinite(u).all() else "no number is predicted"
    for region, axis in sides:
        held = np.all([np.isclose(x[:, "xy".index(k)], v) for k, v in region.items()], axis=0)
        moved = float(np.abs(u[held, "xy".index(axis)]).max())
        if moved > 0:
            finding = f"a held component moves by {moved:.2g} m"
    if not finding and apart(steps.field("c.npz"), steps.field("s.npz")) > SAME:
        finding = "the correction is not datagen's equilibrium"
    return steps.ended("train", change, finding)


def pressed(random: Random, material: Material, folder: Path) -> Outcome:
    """Inflate and push the finger: correction and finite elements agree."""
    load = ["--load", f"notches:{random.uniform(0, 1500)!r}"]
    if random.random() < 0.5:
        force = ",".join(repr(random.uniform(-0.15, 0.15)) for _ in range(3))
        load += ["--load", f"0.088,0.01,0.008:{force}"]
    words = ["predict", "finger3d", *load, "--nearest"]
    steps, change = Steps(material, folder), " ".join(load)
    way = random.choice(([], ["fast"]))
    if not steps.take("surrogate", *words, "--certify", *way, "--out", "p.npz", codes=(0, 3)):
        return steps.ended("predict --certify", change)
    if steps.take("surrogate", *words, "--correct", "--out", "c.npz") and steps.take(
        "datagen", "solve", "finger3d", *load, "--nearest", "--out", "s.npz"
    ):
        difference = apart(steps.field("c.npz"), steps.field("s.npz"))
        wrong = f"corrected by {difference:.2g} beside datagen" if difference > SAME else ""
        return steps.ended("predict --correct", change, wrong)
    return steps.ended("predict --correct", change)


def threads(random: Random, material: Material, folder: Path) -> Outcome:
    """Call one model from several threads at once: each answer as from one thread."""
    return on_a_network("threads", random, material, folder)


def aliasing(random: Random, material: Material, folder: Path) -> Outcome:
    """Overwrite what a model was given and has returned: the next answers stay the same."""
    return on_a_network("aliasing", random, material, folder)


def strangers(random: Random, material: Material, folder: Path) -> Outcome:
    """Serve a model to pages of other origins and to damaged requests; a friend is served well."""
    return on_a_network("strangers", random, material, folder)


def on_a_network(command: str, random: Random, material: Material, folder: Path) -> Outcome:
    """Execute a command of the fuzz itself on some network."""
    steps = Steps(material, folder)
    name = random.choice(("run", "beam2d_any", "lshape2d_any", "beam3d_any_reduced"))
    model = str(material.folder / "run") if name == "run" else name
    steps.take("surrogate", command, model, str(random.randrange(2**31)))
    return steps.ended(command, name)


MECHANICS: dict[str, Attack] = {
    "unstable loads": unstable,
    "scaled bodies": scaled,
    "meshes that are none": broken_mesh,
    "meshes of other programs": foreign_mesh,
    "held components and embedded grids": small_surrogate,
    "pressures": pressed,
    "distributed loads": distributed,
    "tolerances": soft,
    "threads": threads,
    "aliasing": aliasing,
    "strangers": strangers,
}
