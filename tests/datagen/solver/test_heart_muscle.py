"""The beam of Land et al. 2015: Guccione's muscle bent by a pressure, as other programs have it."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

from datagen.cases.body import make_body
from datagen.cases.case import read_case
from datagen.solver.load_stepping import solve_load_case

BEAM = {  # problem 1, in m and Pa: 10 × 1 × 1 mm with fibres along x, 4 Pa from below
    "name": "beam",
    "mesh": {"kind": "box", "lower": [0, 0, 0], "upper": [0.01, 0.001, 0.001]},
    "material": {
        "model": "guccione",
        "stiffness": 2000,
        "b_f": 8,
        "b_t": 2,
        "b_fs": 4,
        "bulk_modulus": 1.0e6,
        "fibres": [1, 0, 0],
    },
    "element": "incompressible",
    "supports": [{"x": 0}],
    "load": {"family": "pressure", "region": {"z": 0}, "range": [1, 4]},
    "dataset": {"samples": 1, "seed": 1},
}


@pytest.mark.slow  # compiles kernels for a minute
def test_deflection_of_the_beam() -> None:
    """Position of the middle of the upper edge of the end: z between 4.14 and 4.20 mm.

    These are the results of all programs in Land et al., Proc. R. Soc. A 471 (2015) 20150641,
    Figure 5. The body of this test is nearly incompressible: K = 500 C.
    """
    case = read_case({**BEAM, "mesh": {**BEAM["mesh"], "elements": [40, 4, 4]}})  # type: ignore[dict-item]
    body = make_body(case, MPI.COMM_SELF)
    load, settings = body.loads[0], case.solver
    pressure = np.array([4.0])
    assert solve_load_case(body.problem, load.nodes, load.forces, settings, pressure).solved
    u, x = body.problem.displacement(), body.mesh.coordinates
    end = np.isclose(x, [0.01, 0.0005, 0.001]).all(axis=1)
    ((_, y, z),) = 1e3 * (x + u)[end]
    assert y == pytest.approx(0.5, abs=1e-6)
    assert 4.14 < z < 4.20
