"""Datasets of axial forces, some of which buckle the beam: stability in shards and commands."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import datagen
from datagen.command_line import main
from datagen.mesh.box import Box
from datagen.transforms.reindexing import structure
from shared_schema.common.errors import WorkError
from shared_schema.dataset_reader import DatasetReader
from shared_schema.layout import Arrays
from shared_schema.load_cases import LoadCases, write_load_cases
from shared_schema.manifest import Manifest, write_manifest
from shared_schema.shard import read_shard, write_shard
from tests.datagen.farm_runs import assert_same, finish, held, pids_of, recorded, start, wait_until
from tests.datagen.farm_runs import datagen as words

SHARDS = ("dataset.shard_size=3", "load.region={x: '> 0'}")
Runner = Callable[..., Manifest]


@pytest.fixture(scope="module")
def loads(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine forces of −16, −12 … 16 N along the axis; the beam buckles at 8.8 N."""
    x = Box(lower=(0, 0), upper=(4, 1), elements=(15, 3)).raw_mesh().coordinates
    forces = np.zeros((9, *x.shape))
    forces[:, x[:, 0] == 4, 0] = np.linspace(-4, 4, 9)[:, None]
    path = tmp_path_factory.mktemp("loads") / "axial.h5"
    write_load_cases(path, LoadCases.of(x, forces), "quad")
    return path


@pytest.fixture(scope="module")
def run(loads: Path) -> Runner:
    def run_axial(out: Path, *changes: str) -> Manifest:
        # the region of the given loads is the whole body but for the support
        return datagen.run(
            "beam2d", out, loads=loads, changes=(*SHARDS, *changes), comm=MPI.COMM_SELF
        )

    return run_axial


@pytest.fixture(scope="module")
def followed(run: Runner, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("followed") / "nodal"
    run(folder)
    return folder


def samples(folder: Path) -> Arrays:
    names = ("samples/number", "samples/displacement", "samples/stable")
    return DatasetReader(folder).joined(names)


def test_followed(followed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """−16 and −12 N buckle the beam, all others leave it straight; every state is stable."""
    found = samples(followed)
    assert found["samples/stable"].all()
    sideways = np.abs(found["samples/displacement"][:, -1, 1])
    assert (sideways[:2] > 1.0).all()
    assert (sideways[2:] < 0.1).all()
    manifest = DatasetReader(followed).manifest
    assert manifest.solver is not None
    assert (manifest.solver.stability, manifest.solver.imperfection) == ("follow", 0)
    assert "stability" not in manifest.case["solver"]  # so older cases keep their digest
    assert main(["check", str(followed)]) == 0
    assert "unstable" not in capsys.readouterr().out
    assert datagen.info(followed)["stability"] == "no unstable samples"


def test_mirror_images_by_the_imperfection(followed: Path, run: Runner, tmp_path: Path) -> None:
    """All samples of a dataset lie on one branch; some seed below 10 gives the other one."""
    ups = set()
    for seed in range(10):
        run(tmp_path / str(seed), f"solver.imperfection={seed}")
        sideways = samples(tmp_path / str(seed))["samples/displacement"][:2, -1, 1]
        assert abs(np.sign(sideways).sum()) == 2
        ups.add(bool(sideways[0] > 0))
        if len(ups) == 2:
            break
    assert len(ups) == 2


def test_allowed(run: Runner, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The straight states are recorded; `check` and `info` name them, also on the grid."""
    run(tmp_path / "nodal", "solver.stability=allow")
    datagen.add_noise(tmp_path / "nodal", tmp_path / "noisy", relative=0.1, threshold=1.0, seed=1)
    structure(tmp_path / "nodal", tmp_path / "grid")
    structure(tmp_path / "nodal", tmp_path / "embedded", grid=(9, 4))
    for name in ("nodal", "noisy", "grid", "embedded"):
        assert main(["check", str(tmp_path / name)]) == 0
        assert "intact; 2 unstable samples, numbers 0, 1" in capsys.readouterr().out
        assert datagen.info(tmp_path / name)["stability"] == "2 unstable samples, numbers 0, 1"
    found = samples(tmp_path / "nodal")
    assert found["samples/stable"].tolist() == [False] * 2 + [True] * 7
    assert np.abs(found["samples/displacement"][:, -1, 1]).max() < 0.1


def test_failed(run: Runner, tmp_path: Path) -> None:
    manifest = run(tmp_path / "nodal", "solver.stability=fail")
    assert (manifest.samples, manifest.failed) == (7, 2)
    failed = DatasetReader(tmp_path / "nodal").joined(("failed/number", "failed/reason"))
    assert failed["failed/number"].tolist() == [0, 1]
    assert set(failed["failed/reason"]) == {"unstable equilibrium"}


def test_one_load(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Four forces of −5 N: the straight state has −1.31 J, the buckled one −36.5 J."""
    load = [f"4,{y}:-5,0" for y in ("0", "0.333333333333", "0.666666666667", "1")]
    straight = datagen.solve("beam2d", load, nearest=True, changes=["solver.stability=allow"])
    buckled = datagen.solve("beam2d", load, nearest=True)
    assert (straight.report.stable, buckled.report.stable) == (False, True)
    assert straight.largest_displacement == pytest.approx(0.137, abs=0.003)
    assert buckled.largest_displacement > 5.0
    line = ["solve", "beam2d", "--load", "4,0:-10,0", "--load", "4,1:-10,0", "--out"]
    assert main([*line, str(tmp_path / "buckled.npz")]) == 0
    assert "past an unstable equilibrium" in capsys.readouterr().out
    allowed = ["--set", "solver.stability=allow"]
    assert main([*line, str(tmp_path / "straight.npz"), *allowed]) == 0
    assert ", an unstable equilibrium" in capsys.readouterr().out
    with pytest.raises(WorkError, match=r"unstable equilibrium .*'solver.stability' = 'fail'"):
        datagen.solve("beam2d", load, nearest=True, changes=["solver.stability=fail"])


def test_datasets_of_earlier_versions(followed: Path, tmp_path: Path) -> None:
    """Without `samples/stable` a dataset is read as before, and nothing is said of it."""
    manifest, entries = DatasetReader(followed).manifest, []
    (tmp_path / "nodal").mkdir()
    for entry in manifest.shards:
        arrays = read_shard(followed / entry.file, "nodal")
        del arrays["samples/stable"]
        path = tmp_path / "nodal" / entry.file
        digest = write_shard(path, "nodal", arrays, manifest.case_digest, "quad")
        entries.append(entry.model_copy(update={"sha256": digest}))
    stiffness = (followed / "stiffness.h5").read_bytes()
    (tmp_path / "nodal" / "stiffness.h5").write_bytes(stiffness)
    update = {"shards": tuple(entries)}
    write_manifest(tmp_path / "nodal", manifest.model_copy(update=update))
    assert datagen.check(tmp_path / "nodal") == []
    assert DatasetReader(tmp_path / "nodal").unstable() is None
    assert "stability" not in datagen.info(tmp_path / "nodal")
    structure(tmp_path / "nodal", tmp_path / "grid")
    assert datagen.check(tmp_path / "grid") == []


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize("shared", [1, 2])
def test_same_on_two_ranks(followed: Path, loads: Path, tmp_path: Path, shared: int) -> None:
    """Two ranks find the same states, and the same mirror images, apart or in one solve."""
    out = tmp_path / "nodal"
    changes = [word for each in SHARDS for word in ("--set", each)]
    changes += ["--loads", str(loads), "--ranks-per-solve", str(shared)]
    result = finish(words("run", "beam2d", "--out", out, *changes, ranks=2))
    assert result.returncode == 0, result.stderr
    if shared == 1:
        assert_same(out, followed)
    one, two = samples(followed), samples(out)
    np.testing.assert_array_equal(one["samples/stable"], two["samples/stable"])
    np.testing.assert_allclose(
        one["samples/displacement"], two["samples/displacement"], rtol=0, atol=1e-6
    )


@pytest.mark.faults
@pytest.mark.slow
def test_killed_and_resumed(followed: Path, loads: Path, run: Runner, tmp_path: Path) -> None:
    """A run that is killed after its first shard ends as if it had not been."""
    out = tmp_path / "nodal"
    changes = [word for each in SHARDS for word in ("--set", each)]
    command = words("run", "beam2d", "--loads", loads, "--out", out, *changes)
    with start(held(command, tmp_path / "gate", 1)) as process:
        wait_until(lambda: recorded(out) >= 1, process)
        os.kill(pids_of(out)[0], signal.SIGKILL)
        process.communicate(timeout=60)
    assert process.returncode == -signal.SIGKILL
    run(out)
    assert_same(out, followed)
