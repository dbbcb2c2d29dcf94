"""One step at a time in the folder of a dataset."""

from __future__ import annotations

from pathlib import Path

import pytest
from mpi4py import MPI

from datagen.cases.case import read_case
from datagen.farm.farm import run
from datagen.transforms.added_noise import add_noise
from datagen.transforms.reindexing import structure
from shared_schema.checker import check_dataset
from shared_schema.common.errors import InputError
from shared_schema.common.folder_lock import FolderLock
from tests.datagen.farm_runs import datagen, start, write_case


@pytest.fixture(scope="module")
def nodal(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """40 shards, so that a step takes a while."""
    folder = tmp_path_factory.mktemp("data")
    case = read_case(str(write_case(folder, samples=400, shard_size=10)))
    run(case, folder / "nodal", comm=MPI.COMM_SELF)
    return folder / "nodal"


def test_a_folder_in_use_is_refused(
    nodal: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shared_schema.common.folder_lock.WAIT", 0.1)
    out = tmp_path / "out"
    refused = pytest.raises(InputError, match="another run is working in it")
    with FolderLock(out), refused:
        structure(nodal, out)
    with FolderLock(out), refused:
        add_noise(nodal, out, seed=0)
    assert list(out.iterdir()) == []


@pytest.mark.slow
def test_two_orders_at_once(nodal: Path, tmp_path: Path) -> None:
    """Whoever comes second waits or is refused; what is there in the end is whole."""
    out = tmp_path / "grid"
    for _ in range(2):
        orders = ["gmsh", "random"]
        steps = [start(datagen("structure", nodal, "--out", out, "--order", o)) for o in orders]
        said = [step.communicate(timeout=120)[1] for step in steps]
        codes = sorted(step.returncode for step in steps)
        assert codes in ([0, 0], [0, 2])
        assert codes == [0, 0] or any("another run is working in it" in line for line in said)
        assert check_dataset(out) == []
