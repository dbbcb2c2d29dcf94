"""An estimate of a run beside the run itself."""

from __future__ import annotations

from pathlib import Path

import pytest
from mpi4py import MPI

from datagen.cases.case import read_case
from datagen.command_line import main
from datagen.farm.farm import run
from datagen.farm.run_estimate import MOST, dry_run
from shared_schema.common.errors import InputError
from tests.datagen.farm_runs import datagen, finish, write_case
from tests.datagen.refusal import refusal


def test_sizes_are_those_of_the_run(tmp_path: Path) -> None:
    case = read_case(str(write_case(tmp_path, samples=500, shard_size=100)))
    estimate = dry_run(case, comm=MPI.COMM_SELF)
    assert (estimate.nodes, estimate.cells, estimate.dofs) == (64, 45, 128)
    assert (estimate.samples, estimate.groups, estimate.failed) == (500, 1, 0)
    assert 2 <= estimate.timed <= MOST
    assert estimate.hours == pytest.approx(500 * estimate.seconds / 3600)
    run(case, tmp_path / "nodal", comm=MPI.COMM_SELF)
    found = sum(path.stat().st_size for path in (tmp_path / "nodal").iterdir())
    assert estimate.bytes == pytest.approx(found, rel=0.1)


def test_command_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case, out = write_case(tmp_path, samples=7), tmp_path / "nodal"
    assert main(["run", str(case), "--out", str(out), "--dry-run"]) == 0
    printed = capsys.readouterr().out
    assert "64 nodes, 45 cells, 128 DOFs" in printed
    assert "the mean of 7\n" in printed
    assert "7 samples, 1 at a time" in printed
    assert not out.exists()
    wrong = ["run", str(case), "--out", str(out), "--dry-run", "--set", "supports.0.x=9"]
    assert "no node of the mesh lies there" in refusal(wrong, capsys)


def test_few_samples_and_wrong_ranks(tmp_path: Path) -> None:
    case = read_case(str(write_case(tmp_path, samples=1)))
    assert dry_run(case, comm=MPI.COMM_SELF).timed == 1
    with pytest.raises(InputError, match="--ranks-per-solve 2: expected a divisor"):
        dry_run(case, comm=MPI.COMM_SELF, ranks_per_solve=2)


@pytest.mark.mpi
@pytest.mark.slow
def test_groups_of_ranks(tmp_path: Path) -> None:
    """Each rank solves samples of its own, or both solve each sample."""
    case, out = write_case(tmp_path, samples=500), tmp_path / "nodal"
    arguments = ("run", case, "--out", out, "--dry-run")
    done = finish(datagen(*arguments, ranks=2))
    assert done.returncode == 0
    assert "500 samples, 2 at a time" in done.stdout
    done = finish(datagen(*arguments, "--ranks-per-solve", "2", ranks=2))
    assert done.returncode == 0
    assert "500 samples, 1 at a time" in done.stdout
    assert not out.exists()
