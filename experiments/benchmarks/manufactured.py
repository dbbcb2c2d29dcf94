"""Rates of convergence to manufactured solutions: elements, materials, plane and space.

    python -m experiments benchmark manufactured

writes its record and its page.
"""

from __future__ import annotations

import argparse
import logging
from dataclasses import asdict

from datagen.discretisation import ELEMENTS
from experiments.benchmarks.benchmark import Results
from experiments.framework.report import markdown_table
from tests.datagen.solver.manufactured import (
    MATERIALS,
    NEARLY_INCOMPRESSIBLE,
    expected_rates,
    measured,
)

logger = logging.getLogger(__name__)
IN_THE_PLANE = (4, 8, 16, 32)
IN_SPACE = {1: (2, 4, 8, 16), 2: (2, 4, 8)}  # by the degree of the element
CELLS = {
    (2, False): "quadrilaterals",
    (2, True): "triangles",
    (3, False): "hexahedra",
    (3, True): "tetrahedra",
}


def measure(options: argparse.Namespace) -> Results:
    """Measure all elements with all materials; nearly incompressible ones if they do not lock."""
    rows: list[Results] = []
    for (d, simplices), cells in CELLS.items():
        for element in ELEMENTS:
            *_, degree = expected_rates(element, simplices)
            meshes = IN_THE_PLANE if d == 2 else IN_SPACE[degree]
            for material in MATERIALS:
                if material == NEARLY_INCOMPRESSIBLE and element != "incompressible":
                    continue
                found = measured(element, d, simplices, material, meshes)
                row: Results = {"cells": cells, "element": element, "material": material}
                row["expected"] = expected_rates(element, simplices)
                row["errors"] = [asdict(each) for each in found.errors]
                row["rates"] = [[round(rate, 3) for rate in rates] for rates in found.rates]
                rows.append(row)
                logger.info("%s %s, %s: %s", element, cells, material, row["rates"][-1])
    last = [zip(row["expected"], row["rates"][-1], strict=True) for row in rows]
    largest = max(power - rate for pairs in last for power, rate in pairs)
    return {"rows": rows, "largest_shortfall": round(largest, 3)}


def page(results: Results) -> str:
    """Make the page."""
    alike: dict[tuple[str, str, str], list[Results]] = {}
    for row in results["rows"]:
        cells, theory = f"{row['cells']}, {row['errors'][-1]['cells']}", "{}, {}"
        kind = cells, row["element"], theory.format(*row["expected"])
        alike.setdefault(kind, []).append(row)
    table = markdown_table(
        ("cells", "`element`", "theory", "displacement", "gradient", "largest error"),
        (
            (
                *kind,
                *(span([row["rates"][-1][i] for row in rows]) for i in (0, 1)),
                f"{max(row['errors'][-1]['displacement'] for row in rows):.1e}",
            )
            for kind, rows in alike.items()
        ),
    )
    materials = ", ".join(
        f"`{name}`" for name in dict.fromkeys(r["material"] for r in results["rows"])
    )
    return f"""\
UFL derives the body force and the tractions under which a box of 1 m takes a displacement of closed
form: one whose volume changes, with stretches of 10 to 30 %; for ν = 0.4999 a shear, and in space a
torsion of up to 29° as well ([the solutions](../../tests/datagen/solver/manufactured.py)). The
lines of the mesh are curved. Rates are powers of the size of the cells with which the errors of
displacement and gradient (L²) fall between the two finest meshes, over all materials: {materials}.
The first column has the number of cells along an edge of the finest mesh, the last one the relative
error of the displacement there. No rate is more than {results["largest_shortfall"]:.2f} below
theory. [A test](../../tests/datagen/solver/test_manufactured_solutions.py) holds the rates.

{table}"""


def span(rates: list[float]) -> str:
    """The least and the largest of some rates."""
    return f"{min(rates):.2f} to {max(rates):.2f}"


TITLE = "Manufactured solutions"
