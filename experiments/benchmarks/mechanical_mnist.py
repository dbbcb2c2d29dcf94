"""Strain energies of Mechanical MNIST (uniaxial extension), beside the published ones.

A square of 28 x 28 is drawn from above and held below; the grey level of each pixel of a
handwritten digit is its Young's modulus, from 1 to 100 (E. Lejeune, *Mechanical MNIST: A benchmark
dataset for mechanical metamodels*, Extreme Mechanics Letters 36, 2020). Bitmaps and energies are
those of

    git clone https://github.com/elejeune11/Mechanical-MNIST

(CC BY-SA 3.0), of which nothing is kept here.

    python -m experiments benchmark mechanical-mnist --folder Mechanical-MNIST

writes its record and its page.
"""

from __future__ import annotations

import argparse
import logging
import zipfile
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.mesh import distributed
from datagen.solver import EquilibriumProblem, SolverSettings
from experiments.benchmarks.benchmark import Results
from experiments.framework.report import markdown_table
from experiments.framework.timing import timed
from shared_schema import NeoHookean
from shared_schema.common import InputError, Parser, WorkError
from tests.datagen.solver.cantilever import box

logger = logging.getLogger(__name__)
PIXELS, LEVELS, POISSON_RATIO = 28, 256, 0.3
SOFT, HARD = 1.0, 100.0  # Young's moduli of grey levels 0 and 255
PUBLISHED = (0.0, 0.001, 0.01, 0.1, 0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0)
SHOWN = (1.0, 4.0, 8.0, 14.0)  # displacements of the upper edge
HALVINGS = 8
REFINED, FEW = (1, 2, 3, 4), 5  # pairs of triangles along a pixel; bitmaps
MATERIALS = tuple(
    NeoHookean(young_modulus=SOFT + (HARD - SOFT) * level / 255, poisson_ratio=POISSON_RATIO)
    for level in range(LEVELS)
)
Array = NDArray[np.float64]


def read_published(folder: Path) -> tuple[NDArray[np.uint8], Array]:
    """Bitmaps of the test set, (n, 28, 28), and their energies at `SHOWN`, (n, 4).

    Raises
    ------
    InputError
        If there are no such files in the folder.
    """
    images = folder / "data" / "mnist_img_test.txt.zip"
    psi = folder / "data" / "summary_psi_test_all.txt"
    for path in (images, psi):
        if not path.is_file():
            raise InputError(f"--folder '{folder}': no {path.name}, expected Mechanical-MNIST")
    with zipfile.ZipFile(images) as archive, archive.open("mnist_img_test.txt") as lines:
        bitmaps = np.loadtxt(lines, dtype=np.uint8).reshape(-1, PIXELS, PIXELS)
    columns = [PUBLISHED.index(displacement) for displacement in SHOWN]
    return bitmaps, np.loadtxt(psi, usecols=columns)


def energies(bitmap: NDArray[np.uint8], per_pixel: int) -> Array:
    """Strain energies at `SHOWN`, by quadratic triangles whose edges are those of the pixels."""
    cells = PIXELS * per_pixel
    raw = box((PIXELS, PIXELS), (cells, cells), simplices=True)
    x, y = raw.coordinates[raw.cells].mean(axis=1).astype(np.int64).T
    levels = bitmap[PIXELS - 1 - y, x].astype(np.int64)
    below, above = (np.isclose(raw.coordinates[:, 1], edge) for edge in (0.0, PIXELS))
    clamped = np.stack([below | above, below], axis=1)
    moved = np.stack([np.zeros_like(above), above], axis=1)
    problem = EquilibriumProblem(
        distributed(raw, MPI.COMM_SELF),
        MATERIALS,
        clamped,
        SolverSettings(linear_solver="lu"),
        "quadratic",
        levels,
        moved,
    )
    drawn = np.zeros_like(raw.coordinates)
    drawn[above, 1] = SHOWN[-1]
    problem.set_load(np.zeros(0, np.int64), np.zeros((0, 2)), displacement=drawn)
    found, reached = [], 0.0
    for displacement in SHOWN:
        advance(problem, reached, displacement / SHOWN[-1])
        reached = displacement / SHOWN[-1]
        found.append(problem.energy())
    problem.close()
    return np.array(found)


def advance(
    problem: EquilibriumProblem, begin: float, end: float, halvings: int = HALVINGS
) -> None:
    """Go from one part of the displacement to another, by halves where Newton's method fails."""
    state = problem.state()
    result = problem.solve(end)
    if result.converged:
        return
    if not halvings:
        raise WorkError(f"no equilibrium: {result.explanation}")
    problem.restore(state)
    for one, other in ((begin, (begin + end) / 2), ((begin + end) / 2, end)):
        advance(problem, one, other, halvings - 1)


def measure(options: argparse.Namespace) -> Results:
    """Solve bitmaps from the first one on, and a few of them on other meshes."""
    bitmaps, published = read_published(options.folder)
    with ProcessPoolExecutor(options.processes, get_context("spawn")) as pool:

        def differences(count: int, per_pixel: int) -> Array:
            found = []
            some = pool.map(partial(energies, per_pixel=per_pixel), bitmaps[:count])
            for number, row in enumerate(some):
                found.append(row / published[number] - 1)
                logger.info("bitmap %d, %d: %s", number, per_pixel, np.round(found[-1], 5))
            return np.array(found)

        refined = [
            {"per_pixel": n, "mean": differences(FEW, n).mean(axis=0).tolist()} for n in REFINED
        ]
        all_of_them, seconds = timed(lambda: differences(options.count, options.per_pixel))
    return {
        "bitmaps": options.count,
        "per_pixel": options.per_pixel,
        "seconds": round(seconds / options.count, 2),
        "displacements": list(SHOWN),
        "median": np.median(all_of_them, axis=0).tolist(),
        "least": all_of_them.min(axis=0).tolist(),
        "most": all_of_them.max(axis=0).tolist(),
        "refined": refined,
    }


def page(results: Results) -> str:
    """Make the page."""
    along = results["per_pixel"]

    def percent(values: list[float]) -> list[str]:
        return [f"{100 * value:+.2f} %" for value in values]

    head = ("", *(f"d = {d:g}" for d in results["displacements"]))
    rows = [(name, *percent(results[name])) for name in ("median", "least", "most")]
    meshes = [
        (f"{r['per_pixel']} × {r['per_pixel']} × 2", *percent(r["mean"]))
        for r in results["refined"]
    ]
    return f"""\
A square of 28 × 28 is held below and drawn from above by d; the grey level of each pixel of a
handwritten digit is its Young's modulus, from 1 to 100, with ν = 0.3 and the energy of the paper.
Published are strain energies by FEniCS, with quadratic triangles of about a fifth of a pixel, whose
edges are not those of the pixels (E. Lejeune, *Mechanical MNIST*, Extreme Mechanics Letters 36,
2020; [data](https://github.com/elejeune11/Mechanical-MNIST), CC BY-SA 3.0). Here the triangles,
quadratic as well, share the edges of the pixels, {along} × {along} × 2 in each.

Strain energy minus the published one, relative to that, of the first {results["bitmaps"]} test
bitmaps:

{markdown_table(head, rows)}
On other meshes, in the mean of the first {FEW} bitmaps, by triangles in a pixel:

{markdown_table(("triangles", *head[1:]), meshes)}
The energy falls with the size of the triangles: differences are those of two discretisations, of
which the published one does not follow the edges of the pixels.

A displacement of a bitmap takes {results["seconds"] / len(SHOWN):.1f} s.
"""


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--folder", type=Path, required=True, help="a clone of Mechanical-MNIST")
    parser.add_argument("--count", type=int, default=200, help="bitmaps (default 200)")
    parser.add_argument("--per-pixel", type=int, default=2, help="cells along a pixel (default 2)")
    parser.add_argument("--processes", type=int, default=2, help="at once (default 2)")


TITLE = "Mechanical MNIST"
