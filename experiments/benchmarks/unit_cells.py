"""Unit cells with holes, the family of PLAID's 2D_MultiScHypEl: series and networks, scored.

    python -m experiments benchmark unit-cells --folder build/unit-cells

makes the cells that are not there, and writes its record and its page. Whoever has the data of
PLAID (https://huggingface.co/datasets/PLAID-datasets/2D_Multiscale_Hyperelasticity) adds
``--plaid FOLDER --python PYTHON``, with the interpreter of an environment that has pyplaid.
"""

from __future__ import annotations

import argparse
import subprocess
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from experiments.benchmarks.benchmark import Benchmark, Results
from experiments.framework.machine import ROOT
from experiments.framework.report import markdown_table
from experiments.framework.timing import timed
from experiments.unit_cells.material import FoundMaterial, found_material
from experiments.unit_cells.mechanics import SolidCell
from experiments.unit_cells.network import (
    FieldPredictor,
    Views,
    geometry_views,
    mechanics_views,
)
from experiments.unit_cells.unit_cell import (
    ENERGY,
    FIELDS,
    Prediction,
    UnitCell,
    median_score,
    read_cells,
    scores,
)
from shared_schema import NeoHookean
from shared_schema.common import InputError, Parser, Progress, WorkError

DATAGEN = ROOT / ".venv-datagen" / "bin" / "python"
TEST = 376 / 1140  # share of the cells, the last ones
FOR_THE_MATERIAL = 40  # cells
EXACT = 1e-3  # relative errors of energies and outer edge below which a material counts as known
READER, UNFIT = ROOT / "experiments" / "unit_cells" / "read_plaid.py", 3
PUBLISHED = {
    "Augur": 0.0232,
    "FNO": 0.0302,
    "vision transformer": 0.0325,
    "MeshGraphNets": 0.0437,
    "MARIO": 0.0573,
}
Array = NDArray[np.float64]
Row = tuple[list[Prediction], float]  # predictions of the last cells, seconds of one


@dataclass(frozen=True)
class Mechanics:
    """What mechanics alone says of a cell, with the seconds that each takes.

    Attributes
    ----------
    states : dict of Prediction
        By the name of the row.
    seconds : dict of float
        One after the other, what comes before among them.
    gradient : array, (n_triangles, 4)
        Of the linear response.
    """

    states: dict[str, Prediction]
    seconds: dict[str, float]
    gradient: Array


LINEAR, SERIES, ONE, TWO = (
    "linear response",
    "series of third order, least energy",
    "series, one step of Newton's method",
    "series, two steps",
)
GEOMETRY, UPON, CORRECTED = (
    "U-Net that sees holes and stretch",
    "U-Net upon the linear response",
    "U-Net upon the linear response, one step",
)


def mechanics_of(cell: UnitCell, material: NeoHookean) -> Mechanics:
    """Apply mechanics to one cell."""
    torch.set_num_threads(1)
    solid, total = timed(lambda: SolidCell(cell, material))
    terms, taken = timed(lambda: solid.terms)
    total, u = total + taken, cell.homogeneous + terms[0]
    states, seconds, gradient = {LINEAR: solid.prediction(u)}, {LINEAR: total}, solid.gradient(u)
    for name in (SERIES, ONE, TWO):
        u, taken = timed(solid.series if name == SERIES else partial(solid.corrected, u))
        total += taken
        states[name], seconds[name] = solid.prediction(u), total
    return Mechanics(states, seconds, gradient)


def corrected(
    cell: UnitCell, prediction: Prediction, material: NeoHookean
) -> tuple[Prediction, Prediction, float]:
    """The strain energy of a predicted displacement, one step of Newton's method, its seconds."""
    torch.set_num_threads(1)
    solid, u = SolidCell(cell, material), prediction.fields[:, :2]
    if solid.is_inverted(u):
        return prediction, prediction, 0.0
    balanced = prediction._replace(energy=solid.prediction(u).energy)
    u, seconds = timed(lambda: solid.corrected(u))
    return balanced, solid.prediction(u), seconds


def measure(options: argparse.Namespace) -> Results:
    """Find the material, train, and score what is predicted of the last cells."""
    if options.plaid is not None:
        convert(options)
    elif sum(1 for _ in options.folder.glob("*")) < options.count:
        command = [DATAGEN, "-m", "experiments.unit_cells.generate", options.folder, options.count]
        subprocess.run(list(map(str, command)), check=True, cwd=ROOT)
    cells = read_cells(options.folder)
    test = max(1, round(TEST * len(cells)))
    known = cells[-test:]
    found = found_material(cells[:-test][:FOR_THE_MATERIAL])
    rows = {GEOMETRY: trained(cells, [geometry_views(cell) for cell in cells], test, options)}
    if found is not None and max(found.energy_error, found.edge_error) < EXACT:
        rows |= with_mechanics(cells, found.material, test, options)
    return {
        "plaid": options.plaid is not None,
        "cells": len(cells),
        "test": test,
        "nodes": round(float(np.mean([len(cell.coordinates) for cell in cells]))),
        "failed": sum(1 for _ in options.folder.glob("*.failed")),
        "material": described(found),
        "channels": options.channels,
        "epochs": options.epochs,
        "seed": options.seed,
        "rows": {
            name: {
                "scores": dict(scores(known, found)),
                "median": median_score(known, found),
                "seconds": seconds,
            }
            for name, (found, seconds) in rows.items()
        },
    }


def with_mechanics(
    cells: list[UnitCell], material: NeoHookean, test: int, options: argparse.Namespace
) -> dict[str, Row]:
    """Predict the last cells by mechanics, by a network upon it, and by that corrected."""
    progress = Progress(len(cells), 0, "cells", "mechanics")
    with ProcessPoolExecutor(options.processes, get_context("spawn")) as pool:
        views, last = [], []
        every = pool.map(partial(mechanics_of, material=material), cells)
        for number, (cell, each) in enumerate(zip(cells, every, strict=True)):
            views.append(mechanics_views(cell, each.states[LINEAR], each.gradient))
            if number >= len(cells) - test:
                last.append(each)
            progress.update(number + 1)
        progress.close("done")
        rows: dict[str, Row] = {
            name: (
                [each.states[name] for each in last],
                float(np.median([each.seconds[name] for each in last])),
            )
            for name in (LINEAR, SERIES, ONE, TWO)
        }
        predictions, seconds = trained(cells, views, test, options)
        step = partial(corrected, material=material)
        energies, steps, taken = zip(*pool.map(step, cells[-test:], predictions), strict=True)
        rows[UPON] = list(energies), rows[LINEAR][1] + seconds
        rows[CORRECTED] = list(steps), rows[UPON][1] + float(np.median(taken))
    return rows


def described(found: FoundMaterial | None) -> Results | None:
    """The material for the record."""
    if found is None:
        return None
    return {
        **found.material.model_dump(),
        "energy_error": found.energy_error,
        "edge_error": found.edge_error,
    }


def trained(
    cells: list[UnitCell], views: list[Views], test: int, options: argparse.Namespace
) -> Row:
    """Train on all but the last cells, predict those, and say the seconds of one."""
    of = options.channels, options.epochs, options.seed
    predictor = FieldPredictor(cells[:-test], views[:-test], *of)
    torch.set_num_threads(1)
    last = list(zip(cells[-test:], views[-test:], strict=True))
    found, seconds = timed(lambda: [predictor.predict(*each) for each in last])
    torch.set_num_threads(options.processes)
    return found, seconds / test


def convert(options: argparse.Namespace) -> None:
    """Write the samples of a PLAID dataset as files of cells."""
    script = [str(options.python), str(READER), str(options.plaid), str(options.folder)]
    done = subprocess.run(script, capture_output=True, text=True, check=False)
    if done.returncode == UNFIT:
        raise InputError(f"--plaid {done.stdout.strip()}")
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise WorkError(f"pyplaid ended with exit code {done.returncode}: {last}")


def page(results: Results) -> str:
    """Make the page."""
    head = ("", "total", "worst field", "energy", "median total of a cell", "ms a cell")
    rows = [
        (
            name,
            f"{row['scores']['total']:.4f}",
            f"{max(row['scores'][field] for field in FIELDS):.4f}",
            f"{row['scores'][ENERGY]:.4f}",
            f"{row['median']:.2g}",
            f"{1e3 * row['seconds']:.0f}",
        )
        for name, row in results["rows"].items()
    ]
    published = ", ".join(f"{name} {score:.4f}" for name, score in PUBLISHED.items())
    return f"""\
PLAID's task 2D_MultiScHypEl (F. Casenave et al., arXiv 2505.02974) asks for the fields in unit
cells of a hyperelastic solid, squares with a random number of circular holes, under a macroscopic
stretch C. A score is the mean over seven fields and the effective energy of the relative errors
([the formula](https://plaid-lib.readthedocs.io)). Published scores of the hidden test split:
{published}.

{PLAIDS if results["plaid"] else family(results)}
{markdown_table(head, rows)}
The first network sees the distance from the holes and the stretch, as the published ones do. U-Nets
have {results["channels"]} channels on a grid of 64 × 64 and {results["epochs"]} epochs (seed
{results["seed"]}). A few worst cells determine a score, which is a root of squares; the median is
that of the scores of single cells. Times are of one thread.

{known(results["material"]) if LINEAR in results["rows"] else UNKNOWN}
With PLAID's data on disk, `python -m experiments benchmark unit-cells --folder build/plaid-cells
--plaid 2D_Multiscale_Hyperelasticity --python .venv-plaid/bin/python` makes this table for the
last third of its training split.
"""


PLAIDS = "What follows is of its training split, of which the last third is predicted.\n"
UNKNOWN = "The cells are of no Neo-Hookean material with a homogeneous outer edge: no mechanics.\n"


def family(results: Results) -> str:
    """What the cells made here are."""
    return f"""\
The table is of a family made by the same description:
[holes, stretches and solutions](../../experiments/unit_cells/generate.py) of {results["cells"]}
cells with {results["nodes"]} nodes in the mean, of which the last {results["test"]} are predicted
({results["failed"]} further ones have no equilibrium that load stepping finds). The description
leaves open the holes (here 1 to 9, of 8 to 35 % of the area), the stretch (here 0.85 to 1.25,
shears of ±0.15), the material (here Neo-Hookean, ν = 0.3), the outer edge (here it moves
homogeneously) and how stresses come to nodes. So scores here and there compare sizes of errors, not
methods.
"""


def known(material: Results) -> str:
    """What the rows with mechanics are."""
    return f"""\
All other rows know the mechanics: the energies of {FOR_THE_MATERIAL} training cells give the
material (E = {material["young_modulus"]:.6g}, ν = {material["poisson_ratio"]:.6g},
`{material["volumetric"]}`; energies within {material["energy_error"]:.0e}). A series of third order
in the stretch factorises K of the cell at rest once; each step of Newton's method factorises again.
A network upon the linear response predicts the rest of displacement and stresses.
"""


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--folder", type=Path, required=True, help="cells, made if not there")
    parser.add_argument("--count", type=int, default=1140, help="cells (default 1140)")
    parser.add_argument("--channels", type=int, default=16, help="of the U-Nets (default 16)")
    parser.add_argument("--epochs", type=int, default=40, help="of their training (default 40)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2, help="at once, and threads (default 2)")
    parser.add_argument("--plaid", type=Path, help="2D_MultiScHypEl on disk, in place of our cells")
    parser.add_argument("--python", type=Path, default="python3", help="interpreter with pyplaid")


BENCHMARK = Benchmark(
    name="unit-cells",
    title="Unit cells with holes",
    measure=measure,
    page=page,
    arguments=arguments,
)
