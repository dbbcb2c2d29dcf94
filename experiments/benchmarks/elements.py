"""Convergence of the elements: a bent beam of 100 x 20 x 16 mm, and Cook's membrane.

    OMP_NUM_THREADS=1 .venv-datagen/bin/python -m experiments.benchmarks.elements

writes `docs/results/benchmark-elements.json` and `docs/benchmarks/elements.md`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from datagen.discretisation.element import ELEMENTS
from experiments.benchmarks.publication import (
    Results,
    argument_parser,
    footer,
    markdown_table,
    run_benchmark,
)
from tests.datagen.solver.cantilever import beam_tip, cook_tip

BEAM_RATIOS = (0.4, 0.45, 0.49, 0.499)
COOK_RATIOS = (0.3, 0.45, 0.4999)
COOK_MESHES = (4, 8, 16, 32)
PUBLISHED = 6.9  # m, Cook's membrane with ν = 0.4999 (Simo and Armero 1992)


def timed(solve: Callable[[], float]) -> tuple[float, float]:
    """Result of a solve, and the processor time in s that it took."""
    began = time.process_time()
    found = solve()
    return found, time.process_time() - began


def beam(meshes: tuple[int, ...]) -> list[Results]:
    """Deflections of the beam's end in mm, by element, mesh and Poisson's ratio."""
    rows: list[Results] = []
    for simplices in (False, True):
        for element in ELEMENTS:
            for across in meshes if element == "linear" or not simplices else meshes[:-1]:
                if element == "quadratic" and across == meshes[-1]:
                    continue
                solves = [partial(beam_tip, across, simplices, element, nu) for nu in BEAM_RATIOS]
                found = [timed(solve) for solve in solves]
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


def table(results: Results) -> str:
    """Make the page of the results."""
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
        ),
    )
    return (
        "# Convergence of the elements\n\n"
        "A beam of 100 x 20 x 16 mm (E = 0.5 MPa) is held at one end and bent by a traction of "
        "1 kPa over the other. Mean\ndeflection of that end in mm, by Poisson's ratio and cells "
        "across the thickness of 16 mm (tetrahedra: hexahedra, each\ncut into six). The last "
        "column is the processor time of a body and its solve, for ν = 0.4, compilation "
        f"included.\n\n{bent}\n"
        "Cook's membrane (E = 240.565 Pa, 100 N over the right side, plane strain): rise of its "
        "upper corner in m. With\nν = 0.4999 it is published as "
        f"{PUBLISHED} m (Simo and Armero 1992).\n\n{membrane}\n{footer(results)}"
    )


def main() -> None:
    """Measure, and write the results."""
    parser = argument_parser(__doc__)
    parser.add_argument(
        "--across", type=int, nargs="+", default=[2, 4, 8], help="cells across the beam"
    )
    run_benchmark("elements", "elements", parser, measure, table)


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Results of both studies."""
    return {"cook": cook(), "beam": beam(tuple(options.across))}


if __name__ == "__main__":
    main()
