"""Every shipped body solves alike in any unit: length, stiffness and load times 1e-6 … 1e6."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.typing import NDArray

import datagen
from datagen.cases.case import SHIPPED, read_case
from datagen.farm.farm import run
from datagen.mesh.distributed_mesh import make_mesh
from datagen.transforms.reindexing import structure
from shared_schema.common.configuration import yaml_content
from shared_schema.grid import grid_of
from shared_schema.layout import Arrays
from shared_schema.shard import read_shard

BODIES = ["beam2d", "lshape2d", "plate2d"]
IN_SPACE = [pytest.param(name, marks=pytest.mark.slow) for name in ("beam3d", "finger3d")]
FACTORS = [(1e-6, 1.0), (1e6, 1e-6), (1.0, 1e-6), (1.0, 1e6), (1e-6, 1e-6)]
LOADS = {"beam2d": 1.0, "lshape2d": 0.3, "plate2d": 2.0, "beam3d": 1.0, "finger3d": 0.1}


def scaled(name: str, length: float, modulus: float) -> tuple[dict[str, Any], float]:
    """Content of a shipped case with other lengths and moduli, and what scales its forces."""
    content = yaml_content((SHIPPED / f"{name}.yaml").read_text())
    d = 3 if name.endswith("3d") else 2
    force = modulus * length ** (d - 1)
    mesh = content["mesh"]
    if mesh["kind"] == "file":
        mesh |= {"path": str(SHIPPED / mesh["path"]), "scale": length}
    elif mesh["kind"] == "box":
        mesh |= {end: [length * x for x in mesh[end]] for end in ("lower", "upper")}
    else:
        mesh["arm"]["length"] *= length
        for side in ("width", "height"):
            mesh["block"][side] *= length
    content["material"]["young_modulus"] *= modulus
    if "tolerance" in content.get("solver", {}):
        content["solver"]["tolerance"] *= force
    for load in content["load"] if isinstance(content["load"], list) else [content["load"]]:
        factor = modulus if load["family"] == "pressure" else force
        load["range"] = [factor * bound for bound in load["range"]]
    regions = [*content["supports"], load.get("region", {})]
    for region in regions:
        for axis in ("x", "y", "z"):
            if isinstance(region.get(axis), int | float):
                region[axis] *= length
    return content, force


@pytest.mark.parametrize("name", [*BODIES, *IN_SPACE])
def test_displacements_over_the_length(name: str) -> None:
    """Of the same force over stiffness and length, to 1e-6 of the largest, in as many steps."""
    content, _ = scaled(name, 1.0, 1.0)
    x = make_mesh(read_case(content).mesh, MPI.COMM_SELF).coordinates
    load = np.zeros_like(x)
    load[x[:, 0].argmax(), -1] = -LOADS[name]
    every = name == "beam2d"  # else one load, and fewer lengths
    factors = FACTORS if every else FACTORS[:1] if name == "finger3d" else FACTORS[:2]
    for part in [1.0, 1e-6] if every else [1.0]:
        expected = datagen.solve(content, part * load)
        size = expected.largest_displacement
        for length, modulus in factors:
            other, force = scaled(name, length, modulus)
            found = datagen.solve(other, part * force * load)
            assert found.displacement / length == pytest.approx(
                expected.displacement, abs=1e-6 * size
            )
            if part == 1.0:  # else rounding errors decide
                iterations = expected.report.newton_iterations
                assert abs(found.report.newton_iterations - iterations) <= 1
            assert found.report.residual_norm <= found.tolerance


@pytest.mark.parametrize("name", BODIES[1:])
def test_the_grid_of_a_scaled_dataset(name: str, tmp_path: Path) -> None:
    """The same map between nodes and grid, and the same statistics over the length."""
    found = []
    for length, modulus in ((1.0, 1.0), (1e-6, 1e-6), (1e6, 1e-6)):
        content, _ = scaled(name, length, modulus)
        content["dataset"] |= {"samples": 4, "shard_size": 4, "test_fraction": 0.25}
        folder = tmp_path / f"{length}"
        run(content, folder)
        info = structure(folder, tmp_path / f"{length}-grid").structured
        assert info is not None
        arrays = read_shard(tmp_path / f"{length}-grid" / "shard-00000.h5", "structured")
        found.append((info, arrays, length))
    (first, body, _), *others = found
    for info, arrays, length in others:
        assert info.grid_shape == first.grid_shape
        np.testing.assert_array_equal(arrays["grid/mask"], body["grid/mask"])
        x, y = (places(some) for some in (arrays, body))
        assert x / length == pytest.approx(y, abs=1e-6)
        std = np.array(info.displacement.std) / length
        assert std == pytest.approx(np.array(first.displacement.std), rel=1e-6)


def places(arrays: Arrays) -> NDArray[np.float64]:
    """Positions of the grid points, interpolated between the nodes; on an edge any cell will do."""
    grid = grid_of(arrays)
    nodes, weights = np.maximum(grid.sources, 0), grid.source_weights
    return np.asarray((weights[..., None] * arrays["mesh/coordinates"][nodes]).sum(axis=-2))
