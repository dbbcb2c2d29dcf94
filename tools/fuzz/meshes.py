"""Plates of triangles for the fuzz: right ones, and some that are no meshes."""

from __future__ import annotations

from pathlib import Path
from random import Random

import numpy as np
import yaml

from tools.fuzz.attacks import Outcome
from tools.fuzz.material import Material
from tools.fuzz.steps import Steps

BROKEN = {  # whether the mesh is fine
    "cell twice": False,
    "cell twice, in another order": False,
    "three cells at a facet": False,
    "one cell over others": False,
    "a node beyond its neighbours": False,
    "plates over each other": False,
    "a node twice in a cell": False,
    "a node that does not exist": False,
    "a coordinate that is no number": False,
    "no cells": False,
    "all cells turned over": True,
    "cells in another order": True,
    "as it is": True,
}


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


def write_plate(path: Path, random: Random, kind: str) -> None:
    """Write a plate of 4 × 1 m as a legacy VTK file, changed in one way."""
    x, cells = plate(random.randint(3, 8), random.randint(2, 4))
    one = cells[random.randrange(len(cells))]
    if kind == "cell twice":
        cells = np.vstack((cells, one))
    elif kind == "cell twice, in another order":
        cells = np.vstack((cells, one[[1, 2, 0]]))
    elif kind == "three cells at a facet":
        first, second = next((a, b) for a, b in pairs(cells) if inner(cells, a, b))
        third = x[first] * 0.3 + x[second] * 0.3 + 0.4 * x.mean(axis=0)
        x = np.vstack((x, third))
        cells = np.vstack((cells, (first, second, len(x) - 1)))
    elif kind == "one cell over others":
        x = np.vstack((x, x.mean(axis=0) + np.array(((0.1, 0, 0), (0.6, 0.05, 0), (0.3, 0.3, 0)))))
        cells = np.vstack((cells, np.arange(len(x) - 3, len(x))))
    elif kind == "a node beyond its neighbours":
        inside = np.flatnonzero((x[:, 0] > 0.01) & (x[:, 0] < 3.99) & (x[:, 1] < 0.99))
        x[random.choice(inside.tolist())] += np.array((2.5, 0.7, 0))
    elif kind == "plates over each other":
        cells = np.vstack((cells, cells + len(x)))
        x = np.vstack((x, x + np.array((0.7, 0.1, 0))))
    elif kind == "a node twice in a cell":
        one[0] = one[1]
    elif kind == "a node that does not exist":
        one[0] = random.choice((len(x), -1, 2**31))
    elif kind == "a coordinate that is no number":
        x[random.randrange(len(x)), 0] = random.choice((np.nan, np.inf))
    elif kind == "no cells":
        cells = cells[:0]
    elif kind == "all cells turned over":
        cells = cells[:, ::-1]
    elif kind == "cells in another order":
        cells = cells[random.sample(range(len(cells)), len(cells))]
    path.write_text(as_vtk(x, cells))


def plate(columns: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) in m and triangles (m, 3) of a plate."""
    number = np.arange((columns + 1) * (rows + 1)).reshape(columns + 1, rows + 1)
    i, j = np.meshgrid(np.linspace(0, 4, columns + 1), np.linspace(0, 1, rows + 1), indexing="ij")
    points = np.stack((i.ravel(), j.ravel(), 0 * i.ravel()), axis=1)
    a, b = number[:-1, :-1].ravel(), number[1:, :-1].ravel()
    c, d = number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    return points, np.concatenate((np.stack((a, b, c), axis=1), np.stack((a, c, d), axis=1)))


def pairs(cells: np.ndarray) -> list[tuple[int, int]]:
    """Edges of all cells, as they go round."""
    return [(int(c[i]), int(c[(i + 1) % 3])) for c in cells for i in range(3)]


def inner(cells: np.ndarray, first: int, second: int) -> bool:
    """Whether two cells share the edge between two nodes."""
    return int((np.isin(cells, (first, second)).sum(axis=1) == 2).sum()) == 2


def as_vtk(x: np.ndarray, cells: np.ndarray) -> str:
    """Content of a legacy VTK file of triangles."""
    lines = ["# vtk DataFile Version 3.0", "plate", "ASCII", "DATASET UNSTRUCTURED_GRID"]
    lines += [f"POINTS {len(x)} double", *(" ".join(map(repr, p)) for p in x.tolist())]
    lines += [f"CELLS {len(cells)} {4 * len(cells)}"]
    lines += [" ".join(map(str, (3, *c))) for c in cells.tolist()]
    lines += [f"CELL_TYPES {len(cells)}", *["5"] * len(cells)]
    return "\n".join(lines) + "\n"
