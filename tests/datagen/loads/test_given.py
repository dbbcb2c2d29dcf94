"""Load cases of a file, solved in its order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from datagen.cases.body import Body, make_body
from datagen.cases.case import Case, read_case
from datagen.farm.farm import run
from datagen.solver.load_stepping import solve_load_case
from shared_schema.checker import check_dataset
from shared_schema.common.errors import InputError
from shared_schema.load_cases import LoadCases, write_load_cases
from shared_schema.loads.forces_at_nodes import GivenLoads
from shared_schema.shard import read_shard


@pytest.fixture
def file(beam: Body, tmp_path: Path) -> Path:
    """Two load cases: one force at the beam's corner; three on its upper edge."""
    x = beam.mesh.coordinates
    edge = np.flatnonzero((x[:, 1] == 1) & (x[:, 0] > 3.4))
    forces = np.zeros((2, *x.shape))
    forces[0, edge[-1]] = 0.5, -1.0
    forces[1, edge[:3]] = [[0.1, 0.2], [0.3, -0.4], [-0.5, 0.6]]
    path = tmp_path / "loads.h5"
    write_load_cases(path, LoadCases.of(x, forces), beam.mesh.cell_type)
    return path


def test_loads_of_a_file_are_solved(file: Path, beam: Body, tmp_path: Path) -> None:
    case = read_case("beam2d", loads=file)
    assert case.dataset.samples == 2
    manifest = run(case, tmp_path / "nodal", comm=MPI.COMM_SELF)
    assert (manifest.samples, manifest.failed) == (2, 0)
    assert check_dataset(tmp_path / "nodal") == []
    shard = read_shard(tmp_path / "nodal" / "shard-00000.h5", "nodal")
    for number in range(2):
        assert isinstance(case.load, GivenLoads)
        nodes, forces = case.load.cases.load(number)
        order = np.argsort(nodes)
        kept = shard["samples/loaded_nodes"][number] >= 0
        np.testing.assert_array_equal(shard["samples/loaded_nodes"][number][kept], nodes[order])
        np.testing.assert_array_equal(shard["samples/force"][number][kept], forces[order])
        solve_load_case(beam.problem, nodes, forces, case.solver)
        np.testing.assert_allclose(
            shard["samples/displacement"][number], beam.problem.displacement(), atol=1e-12
        )


def test_dataset_knows_the_file_by_its_checksum(file: Path, tmp_path: Path) -> None:
    """A copy elsewhere is the same case; reading a dataset's case needs no file."""
    case = read_case("beam2d", loads=file)
    copy = tmp_path / "copy.h5"
    copy.write_bytes(file.read_bytes())
    assert read_case("beam2d", loads=copy).digest() == case.digest()
    assert "file" not in case.plain()["load"]
    again = Case.model_validate(case.plain())
    assert again.digest() == case.digest()


def test_wrong_files(file: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file of load cases"):
        read_case("beam2d", loads=tmp_path / "none.h5")
    damaged = tmp_path / "damaged.h5"
    damaged.write_bytes(file.read_bytes()[:-300])
    with pytest.raises(InputError, match="damaged"):
        read_case("beam2d", loads=damaged)
    with pytest.raises(InputError, match="--samples 5: --loads"):
        read_case("beam2d", samples=5, loads=file)
    with pytest.raises(InputError, match="its loads are for another mesh"):
        make_body(read_case("lshape2d", loads=file), MPI.COMM_SELF)


def test_loads_outside_the_region(beam: Body, tmp_path: Path) -> None:
    """The region of `beam2d` is the upper edge."""
    x = beam.mesh.coordinates
    forces = np.zeros((1, *x.shape))
    forces[0, np.flatnonzero((x[:, 1] == 0) & (x[:, 0] == 4))] = 1.0
    path = tmp_path / "loads.h5"
    write_load_cases(path, LoadCases.of(x, forces), beam.mesh.cell_type)
    with pytest.raises(InputError, match="expected some of the 15 nodes of the region"):
        make_body(read_case("beam2d", loads=path), MPI.COMM_SELF)
