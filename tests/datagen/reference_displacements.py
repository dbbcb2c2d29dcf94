"""Displacements of all shipped cases under a few of their loads, kept to compare platforms by.

    OMP_NUM_THREADS=1 .venv-datagen/bin/python -m tests.datagen.reference_displacements

writes them anew, which is needed only where a shipped case changes. The kept ones are made with
dolfinx 0.5.2, PETSc 3.18 and NumPy 1.24 (Debian 12).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.cases.body import Body, make_body
from datagen.cases.case import SHIPPED, Case, read_case
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.material import VOLUMETRIC_TERMS

FILE = Path(__file__).with_suffix(".json")
CASES = sorted(path.stem for path in SHIPPED.glob("*.yaml"))
FRACTIONS = {2: (0.0, 0.45, 1.0), 3: (0.0, 1.0)}  # of the samples of a case, by dimension
KEPT_NODES = 8


def samples_of(case: Case, dimension: int) -> list[int]:
    """Numbers of the samples whose displacements are kept: the first, the last, one between."""
    return [round(fraction * (case.dataset.samples - 1)) for fraction in FRACTIONS[dimension]]


def solved(case: Case, body: Body, sample: int) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Load of a sample as plain data, and the displacement under it: (n_nodes, d) in m."""
    load = case.load.draw(sample, case.dataset.seed, body.loadable_nodes)
    report = solve_load_case(body.problem, load.nodes, load.forces, case.solver)
    assert report.solved, report.explanation
    plain = {"nodes": load.nodes.tolist(), "forces": load.forces.tolist()}
    return plain, body.problem.displacement()


def kept_nodes(count: int) -> NDArray[np.intp]:
    """Numbers of the nodes whose displacements are kept."""
    return np.linspace(0, count - 1, KEPT_NODES).astype(np.intp)


def reference() -> dict[str, Any]:
    """Displacements of all cases and volumetric terms as plain data."""
    found: dict[str, Any] = {}
    for name in CASES:
        for volumetric in VOLUMETRIC_TERMS:
            case = read_case(name, volumetric)
            body = make_body(case, MPI.COMM_SELF)
            for sample in samples_of(case, body.problem.dimension):
                load, u = solved(case, body, sample)
                found[f"{name} {volumetric} {sample}"] = {
                    "load": load,
                    "root_mean_square": float(np.sqrt(np.mean(u**2))),
                    "displacement": u[kept_nodes(len(u))].tolist(),
                }
            body.problem.close()
    return found


if __name__ == "__main__":
    lines = (f"{json.dumps(key)}: {json.dumps(value)}" for key, value in reference().items())
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n")
