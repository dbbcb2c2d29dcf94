"""One plate in files of gmsh 2.2 and Abaqus, as other programs write it, beside a plain one.

Numbers of nodes and elements are labels: with gaps, in any order. A cell may be in two groups. An
element number that is there twice, and two plates that only a node joins, are refused.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from random import Random

import numpy as np
import yaml

from tools.fuzz.attacks import Outcome
from tools.fuzz.material import Material
from tools.fuzz.meshes import as_vtk, plate
from tools.fuzz.steps import Steps, apart

SAME = 1e-9
KINDS = {  # whether the mesh is fine
    "numbers with gaps": True,
    "numbers in any order": True,
    "a cell in two groups": True,
    "capitals": True,
    "an element number twice": False,
    "joined at a node": False,
}
Plate = tuple[np.ndarray, np.ndarray]


def foreign_mesh(random: Random, material: Material, folder: Path) -> Outcome:
    """Solve one load case on the plain file and on another program's; both are the same."""
    suffix, kind = random.choice(list(WRITERS)), random.choice(list(KINDS))
    x, cells = plate(random.randint(3, 6), random.randint(2, 3))
    steps = Steps(material, folder)
    name = f"plate{suffix.upper() if kind == 'capitals' else suffix}"
    meshes = {"plain": (x, cells), "other": joined(x, cells) if "joined" in kind else (x, cells)}
    load = ["--load", f"4,1:{random.uniform(-1, 1)!r},{random.uniform(-1, 1)!r}", "--nearest"]
    (folder / "plate.vtk").write_text(as_vtk(*meshes["plain"]))
    (folder / name).write_text(WRITERS[suffix](*meshes["other"], random, kind))
    for which, file, wall in (("plain", "plate.vtk", {"x": 0}), ("other", name, {"group": "wall"})):
        case = yaml.safe_load((material.folder / "case.yaml").read_text())
        case["mesh"], case["supports"] = {"kind": "file", "path": file}, [wall]
        case["load"] = {"family": "random_node", "range": [-1, 1]}
        (folder / f"{which}.yaml").write_text(yaml.safe_dump(case))
        fine = which == "plain" or KINDS[kind]
        words = "solve", f"{which}.yaml", *load, "--out", f"{which}.npz"
        if not steps.take("datagen", *words, codes=(0 if fine else 2,)) or not fine:
            return steps.ended("solve", f"{kind} in {suffix}")
    fields = [
        in_order(steps.field(f"{which}.npz", "coordinates"), steps.field(f"{which}.npz"))
        for which in ("plain", "other")
    ]
    wrong = apart(*fields)
    finding = f"another displacement, by {wrong:.2g}" if wrong > SAME else ""
    return steps.ended("solve", f"{kind} in {suffix}", finding)


def in_order(x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Rows of a displacement by the places of their nodes, which are rounded."""
    return np.asarray(u[np.lexsort(np.round(x, 6).T)])


def joined(x: np.ndarray, cells: np.ndarray) -> Plate:
    """Two plates, the second on the corner of the first."""
    corner = int(np.linalg.norm(x - (4, 1, 0), axis=1).argmin())
    first = int(np.linalg.norm(x, axis=1).argmin())  # at the origin
    more = cells + len(x)
    more[cells == first] = corner
    return np.vstack((x, x + x[corner])), np.vstack((cells, more))


def labels(count: int, random: Random, kind: str) -> list[int]:
    """Numbers of nodes or elements as a file has them."""
    if kind == "numbers with gaps":
        return sorted(random.sample(range(1, 10 * count), count))
    if kind == "numbers in any order":
        return random.sample(range(1, count + 1), count)
    return list(range(1, count + 1))


def as_gmsh(x: np.ndarray, cells: np.ndarray, random: Random, kind: str) -> str:
    """Content of a file of gmsh 2.2, with the groups `wall` (x = 0) and `plate`."""
    nodes = labels(len(x), random, kind)
    wall = np.flatnonzero(x[:, 0] == 0)
    wall = wall[np.argsort(x[wall, 1])]
    elements = [f"1 2 1 1 {nodes[a]} {nodes[b]}" for a, b in pairwise(wall)]
    elements += ["2 2 2 2 " + " ".join(str(nodes[c]) for c in cell) for cell in cells]
    numbers = labels(len(elements), random, kind)
    if kind == "an element number twice":
        numbers[-1] = numbers[-2]
    lines = [f"{number} {text}" for number, text in zip(numbers, elements, strict=True)]
    if kind == "a cell in two groups":
        again = lines[-1].split()  # gmsh gives it another number
        lines.append(" ".join([str(len(lines) + 1), *again[1:3], "3", *again[4:]]))
    names = ['1 1 "wall"', '2 2 "plate"', '2 3 "part"']
    places = [f"{n} {' '.join(map(repr, p))}" for n, p in zip(nodes, x.tolist(), strict=True)]
    sections = {"PhysicalNames": names, "Nodes": places, "Elements": lines}
    text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
    for name, rows in sections.items():
        text += "\n".join([f"${name}", str(len(rows)), *rows, f"$End{name}"]) + "\n"
    return text


def as_abaqus(x: np.ndarray, cells: np.ndarray, random: Random, kind: str) -> str:
    """Content of a file of Abaqus, with the set of nodes `wall` (x = 0)."""
    nodes, numbers = labels(len(x), random, kind), labels(len(cells), random, kind)
    if kind == "an element number twice":
        numbers[-1] = numbers[-2]
    lines = ["*NODE"]
    lines += [f"{n}, {', '.join(map(repr, p))}" for n, p in zip(nodes, x.tolist(), strict=True)]
    lines += ["*ELEMENT, TYPE=CPS3, ELSET=plate"]
    lines += [
        f"{n}, {', '.join(str(nodes[c]) for c in cell)}"
        for n, cell in zip(numbers, cells, strict=True)
    ]
    if kind == "a cell in two groups":
        lines += ["*ELSET, ELSET=part", str(numbers[0])]
    lines += ["*NSET, NSET=wall", *(str(nodes[i]) for i in np.flatnonzero(x[:, 0] == 0))]
    return "\n".join(lines) + "\n"


WRITERS: dict[str, Callable[[np.ndarray, np.ndarray, Random, str], str]] = {
    ".msh": as_gmsh,
    ".inp": as_abaqus,
}
