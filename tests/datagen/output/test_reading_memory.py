"""Every command that reads a nodal dataset keeps one shard at a time, whatever their number."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest
from mpi4py import MPI

from datagen.cases.case import read_case
from datagen.farm.farm import run
from datagen.output.dataset_info import info
from datagen.output.nodal_samples import NodalSamples
from datagen.output.paraview_series import export
from datagen.transforms.added_noise import add_noise
from datagen.transforms.reindexing import structure
from shared_schema.checker import check_dataset
from tests.datagen.farm_runs import write_case

Reader = Callable[[Path, Path], object]
READERS: dict[str, Reader] = {
    "info": lambda folder, _: info(folder),
    "check": lambda folder, _: check_dataset(folder),
    "structure": lambda folder, out: structure(folder, out / "grid"),
    "noise": lambda folder, out: add_noise(folder, out / "noisy", seed=0),
    "export": lambda folder, out: export(folder, out / "a.pvd", samples="0:20"),
    "samples": lambda folder, _: NodalSamples(folder).evenly_by_displacement(3),
}


def peak(read: Reader, folder: Path, out: Path) -> int:
    """Largest memory in bytes that Python and NumPy take at once."""
    out.mkdir()
    tracemalloc.start()
    read(folder, out)
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return taken


@pytest.fixture(scope="module")
def datasets(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two and twelve shards of 100 samples, 102 KiB of displacements each."""
    folder = tmp_path_factory.mktemp("memory")
    for samples in (200, 1200):
        case = read_case(str(write_case(folder, samples=samples, shard_size=100)))
        run(case, folder / str(samples), comm=MPI.COMM_SELF)
    return folder / "200", folder / "1200"


@pytest.mark.slow
@pytest.mark.parametrize("name", READERS)
def test_more_shards_take_the_same_memory(
    name: str, datasets: tuple[Path, Path], tmp_path: Path
) -> None:
    """Ten shards more would be 1 MiB more; some numbers a sample are allowed: 100 bytes.

    What another thread of the tests takes meanwhile counts as well, but not twice.
    """
    few, many = datasets
    READERS[name](few, tmp_path)  # what is imported and kept once
    taken = peak(READERS[name], few, tmp_path / "few")
    more = min(peak(READERS[name], many, tmp_path / folder) for folder in ("many", "again"))
    assert more - taken < 100 * 1000 + 100_000
