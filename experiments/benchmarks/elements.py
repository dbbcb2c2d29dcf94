"""Convergence of the elements: a bent beam of 100 x 20 x 16 mm, and Cook's membrane.

    python -m experiments benchmark elements

writes its record and its page.
"""

from __future__ import annotations

import argparse
import time
from functools import partial

from datagen.discretisation import ELEMENTS
from experiments.benchmarks.benchmark import Results
from experiments.framework.report import markdown_table
from experiments.framework.timing import timed
from shared_schema.common import Parser
from tests.datagen.solver.cantilever import beam_tip, cook_tip

BEAM_RATIOS = (0.4, 0.45, 0.49, 0.499)
COOK_RATIOS = (0.3, 0.45, 0.4999)
COOK_MESHES = (4, 8, 16, 32)
PUBLISHED = 6.9  # m, Cook's membrane with ν = 0.4999 (Simo and Armero 1992)


def beam(meshes: tuple[int, ...]) -> list[Results]:
    """Deflections of the beam's end in mm, by element, mesh and Poisson's ratio."""
    rows: list[Results] = []
    for simplices in (False, True):
        for element in ELEMENTS:
            for across in meshes if element == "linear" or not simplices else meshes[:-1]:
                if element == "quadratic" and across == meshes[-1]:
                    continue
                solves = [partial(beam_tip, across, simplices, element, nu) for nu in BEAM_RATIOS]
                found = [timed(solve, time.process_time) for solve in solves]
                rows.append(
                    {
                        "cells": "tetrahedra" if simplices else "hexahedra",
                        "element": element,
                        "across": across,
                        "deflection_mm": [round(1e3 * tip, 2) for tip, _ in found],
                        "seconds": round(found[0][1], 2),
                    }
                )
    return rows


def cook() -> list[Results]:
    """Rises of the corner of Cook's membrane in m, by element, mesh and Poisson's ratio."""
    return [
        {
            "cells": "triangles" if simplices else "quadrilaterals",
            "element": element,
            "poisson_ratio": nu,
            "rise_m": [round(cook_tip(n, simplices, element, nu), 3) for n in COOK_MESHES],
        }
        for nu in COOK_RATIOS
        for simplices in (False, True)
        for element in ELEMENTS
    ]


MIDDLE = 0.45  # of Cook's membrane, in the record only


def page(results: Results) -> str:
    """Make the page."""
    bent = markdown_table(
        ("cells", "`element`", "across", *(f"ν = {nu}" for nu in BEAM_RATIOS), "s"),
        (
            (
                row["cells"],
                row["element"],
                str(row["across"]),
                *(f"{value:.2f}" for value in row["deflection_mm"]),
                f"{row['seconds']:.2f}",
            )
            for row in results["beam"]
        ),
    )
    membrane = markdown_table(
        ("ν", "cells", "`element`", *(f"{n} x {n}" for n in COOK_MESHES)),
        (
            (
                f"{row['poisson_ratio']:g}",
                row["cells"],
                row["element"],
                *(f"{value:.3f}" for value in row["rise_m"]),
            )
            for row in results["cook"]
            if row["poisson_ratio"] != MIDDLE
        ),
    )
    return (
        "A beam of 100 x 20 x 16 mm (E = 0.5 MPa), held at one end, is bent by a traction of 1 kPa "
        "over the other. Mean deflection of that end in mm, by Poisson's ratio and cells across "
        "the thickness (tetrahedra: hexahedra, each cut into six); last column: processor time of "
        f"a body and its solve for ν = 0.4.\n\n{bent}\n"
        "Cook's membrane (E = 240.565 Pa, 100 N over the right side, plane strain): rise of its "
        "upper corner in m. For ν = 0.4999 it is published as "
        f"{PUBLISHED} m (Simo and Armero 1992).\n\n{membrane}"
    )


def measure(options: argparse.Namespace) -> Results:
    """Results of both studies."""
    return {"cook": cook(), "beam": beam(tuple(options.across))}


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument(
        "--across", type=int, nargs="+", default=[2, 4, 8], help="cells across the beam"
    )


TITLE = "Convergence of the elements"
