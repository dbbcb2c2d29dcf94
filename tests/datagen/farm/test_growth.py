"""A dataset that grows: as if it had been made at once; nothing that was there is made again."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from datagen.cases.case import Case, read_case
from datagen.command_line import main
from datagen.farm.farm import run
from datagen.farm.shard_job import ShardJob
from datagen.transforms.added_noise import add_noise
from datagen.transforms.reindexing import structure
from shared_schema.checker import check_dataset
from shared_schema.common.errors import InputError
from shared_schema.dataset_reader import DatasetReader
from shared_schema.layout import NODAL
from shared_schema.manifest import read_manifest, write_manifest
from shared_schema.shard import read_shard
from shared_schema.stiffness import read_stiffness
from tests.datagen.farm_runs import TIMES, execute, write_case

LAST = "shard-00002.h5"  # of 45 samples, with 5 of 20


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("growth")


@pytest.fixture(scope="module")
def case_file(folder: Path) -> str:
    return str(write_case(folder, samples=45, shard_size=20))


def case_of(file: str, samples: int) -> Case:
    return read_case(file, samples=samples)


@pytest.fixture(scope="module")
def small(case_file: str, folder: Path) -> Path:
    run(case_of(case_file, 45), folder / "small", comm=MPI.COMM_SELF)
    return folder / "small"


@pytest.fixture(scope="module")
def whole(case_file: str, folder: Path) -> Path:
    run(case_of(case_file, 95), folder / "whole", comm=MPI.COMM_SELF)
    return folder / "whole"


@pytest.fixture
def grown(small: Path, tmp_path: Path) -> Path:
    return shutil.copytree(small, tmp_path / "nodal")


def wall_times(folder: Path) -> np.ndarray:
    return DatasetReader(folder, "nodal").joined(["samples/wall_time"])["samples/wall_time"]


def assert_same_arrays(one: Path, other: Path) -> None:
    """Equal to the last bit but for times; the files themselves name the case of their making."""
    assert check_dataset(other) == []
    pairs = zip(DatasetReader(one, "nodal"), DatasetReader(other, "nodal"), strict=True)
    for (entry, a), (_, b) in pairs:
        assert {layout.path for layout in NODAL if not layout.optional} <= set(a)
        for name in set(a) - TIMES:
            assert np.array_equal(a[name], b[name]), (entry.file, name)
    assert np.array_equal(read_stiffness(one).data, read_stiffness(other).data)


def assert_grown(grown: Path, small: Path, whole: Path) -> None:
    """What one run makes, with the samples that were there."""
    assert_same_arrays(whole, grown)
    assert np.array_equal(wall_times(grown)[:45], wall_times(small))
    for file in ("shard-00000.h5", "shard-00001.h5", "stiffness.h5"):
        assert (grown / file).read_bytes() == (small / file).read_bytes()
    assert not list(grown.glob(".*"))


def test_it_goes_on_and_says_what_it_was(
    case_file: str, small: Path, whole: Path, grown: Path
) -> None:
    before = read_manifest(small)
    manifest = run(case_of(case_file, 95), grown, comm=MPI.COMM_SELF)
    assert_grown(grown, small, whole)
    (stage,) = manifest.history
    assert (stage.samples, stage.failed, stage.digest) == (45, 0, before.digest)
    assert (stage.case_digest, stage.software) == (before.case_digest, before.software)
    assert (manifest.samples, manifest.case["dataset"]["samples"]) == (95, 95)
    assert run(case_of(case_file, 95), grown, comm=MPI.COMM_SELF) == manifest
    again = run(case_of(case_file, 100), grown, comm=MPI.COMM_SELF)
    assert [stage.samples for stage in again.history] == [45, 95]
    assert check_dataset(grown) == []


def test_unfinished_growth_is_said(
    case_file: str, grown: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The smaller dataset is whole; a journal beside it is that of a run that has not ended."""
    (grown / ".journal").mkdir()
    case = case_of(case_file, 95).plain()
    (grown / ".journal" / "case.json").write_text(json.dumps(case))
    for command in ("check", "info"):
        assert main([command, str(grown)]) == 0
        printed = capsys.readouterr().out
        text = f"grows to 95 samples, unfinished; run the same `datagen run … --out {grown}` again"
        assert text in printed


@pytest.mark.mpi
@pytest.mark.slow
def test_on_many_ranks(case_file: str, small: Path, whole: Path, grown: Path) -> None:
    result = execute(2, Path(case_file), grown, "--samples", "95")
    assert result.returncode == 0, result.stderr
    assert_grown(grown, small, whole)


@pytest.mark.faults
@pytest.mark.parametrize("killed_at", [47, 61, 94])
def test_killed_while_it_grows(
    case_file: str,
    small: Path,
    whole: Path,
    grown: Path,
    killed_at: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The smaller dataset can be read all the while; the same command goes on."""
    solve_next = ShardJob.solve_next

    def solve_or_die(job: ShardJob) -> bool:
        if job.numbers[job.done] == killed_at:
            raise KeyboardInterrupt
        return solve_next(job)

    with monkeypatch.context() as patch:
        patch.setattr(ShardJob, "solve_next", solve_or_die)
        with pytest.raises(KeyboardInterrupt):
            run(case_of(case_file, 95), grown, comm=MPI.COMM_SELF)
    assert np.array_equal(wall_times(grown), wall_times(small))
    for samples in (45, 100):
        said = f"dataset.samples = {samples}, but a run of 95 samples is unfinished"
        with pytest.raises(InputError, match=said):
            run(case_of(case_file, samples), grown, comm=MPI.COMM_SELF)
    run(case_of(case_file, 95), grown, comm=MPI.COMM_SELF)
    assert_grown(grown, small, whole)


@pytest.mark.faults
@pytest.mark.parametrize("moment", ["Journal.record", "Journal.drop_parts", "write_manifest"])
def test_killed_at_the_end(
    case_file: str, whole: Path, grown: Path, moment: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def die_of_last(*of: Any) -> None:
        calls.append(of)
        if moment == "write_manifest" or "00002" in str(of) or of[1:] == (2,):
            raise KeyboardInterrupt
        original(*of)

    target = f"datagen.farm.farm.{moment}"
    with monkeypatch.context() as patch:
        from shared_schema.samples.journal import Journal

        original = getattr(Journal, moment.removeprefix("Journal."), pytest.fail)
        patch.setattr(target, die_of_last)
        with pytest.raises(KeyboardInterrupt):
            run(case_of(case_file, 95), grown, comm=MPI.COMM_SELF)
    assert calls
    run(case_of(case_file, 95), grown, comm=MPI.COMM_SELF)
    assert_same_arrays(whole, grown)


def test_damaged_shards_of_a_grown_dataset_are_made_again(
    case_file: str, whole: Path, grown: Path
) -> None:
    first = run(case_of(case_file, 95), grown, comm=MPI.COMM_SELF)
    for name in ("shard-00000.h5", LAST):
        (grown / name).write_bytes(b"")
    assert run(case_of(case_file, 95), grown, comm=MPI.COMM_SELF).history == first.history
    assert_same_arrays(whole, grown)


def test_it_cannot_shrink_nor_become_another(case_file: str, grown: Path) -> None:
    with pytest.raises(InputError, match=r"dataset.samples = 44, the folder has 45; .* only grow"):
        run(case_of(case_file, 44), grown, comm=MPI.COMM_SELF)
    other = case_of(case_file, 95)
    stiffer = other.materials[0].model_copy(update={"young_modulus": 600.0})
    with pytest.raises(InputError, match=r"young_modulus = 600.0, the folder has 500.0"):
        run(other.model_copy(update={"material": stiffer}), grown, comm=MPI.COMM_SELF)
    assert check_dataset(grown) == []


def test_a_dataset_with_noise_is_no_dataset_of_run(
    case_file: str, small: Path, tmp_path: Path
) -> None:
    """Neither grown nor repaired, which would mix samples with noise and without."""
    noisy = tmp_path / "noisy"
    add_noise(small, noisy, seed=1)
    for samples in (45, 95):
        with pytest.raises(InputError, match=r"changed afterwards \(noise\)"):
            run(case_of(case_file, samples), noisy, comm=MPI.COMM_SELF)
    assert check_dataset(noisy) == []


def test_the_steps_after_it(case_file: str, grown: Path, tmp_path: Path) -> None:
    """`noise` and `structure` replace what they made before; no sample changes sides."""
    noisy, grids = tmp_path / "noisy", (tmp_path / "grid", tmp_path / "noisy-grid")

    def make() -> list[dict[str, np.ndarray]]:
        add_noise(grown, noisy, seed=1)
        structure(grown, grids[0])
        structure(noisy, grids[1])
        assert check_dataset(noisy) == []
        names = ["samples/number", "samples/is_test", "samples/displacement"]
        assert [check_dataset(grid) for grid in grids] == [[], []]
        return [DatasetReader(grid, "structured").joined(names) for grid in grids]

    before = make()
    run(case_of(case_file, 95), grown, comm=MPI.COMM_SELF)
    after = make()
    for old, new in zip(before, after, strict=True):
        assert len(new["samples/number"]) == 95
        assert int(new["samples/is_test"].sum()) == 5  # 5 % of 95
        for name, values in old.items():
            assert np.array_equal(new[name][:45], values), name
    info = read_manifest(grids[0]).structured
    assert info is not None
    assert (info.train, info.test) == (90, 5)


def test_shards_that_a_killed_step_left_do_not_stay(
    small: Path, grown: Path, tmp_path: Path
) -> None:
    grid = tmp_path / "grid"
    grid.mkdir()
    (grid / "shard-00007.h5").write_bytes(b"of a larger dataset")
    structure(small, grid)
    assert check_dataset(grid) == []


def test_the_checker_knows_the_history(case_file: str, grown: Path) -> None:
    manifest = run(case_of(case_file, 95), grown, comm=MPI.COMM_SELF)
    (stage,) = manifest.history
    lie = stage.model_copy(update={"samples": 46})
    write_manifest(grown, manifest.model_copy(update={"history": (lie,)}))
    (problem,) = check_dataset(grown)
    assert "history.0" in problem
    write_manifest(grown, manifest.model_copy(update={"history": ()}))
    assert len(check_dataset(grown)) == 2  # the two shards that did not change
    shard = read_shard(grown / LAST, "nodal")
    assert shard["samples/number"].tolist() == list(range(40, 60))
