"""From nodes to grid and back, exactly."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from datagen.cases.case import read_case
from datagen.farm.farm import run
from datagen.transforms.added_noise import add_noise
from datagen.transforms.reindexing import nodal_forces_of, split, structure
from shared_schema.checker import check_dataset
from shared_schema.common.errors import InputError
from shared_schema.common.files import sha256
from shared_schema.grid import Grid
from shared_schema.layout import Arrays
from shared_schema.manifest import NodeOrder, read_manifest, write_manifest
from shared_schema.shard import read_shard, write_shard
from shared_schema.stiffness import STIFFNESS_FILE

SAMPLES = 45


@pytest.fixture(scope="module")
def nodal(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "nodal"
    case = read_case("beam2d", samples=SAMPLES)
    small = case.dataset.model_copy(update={"shard_size": 20})
    run(case.model_copy(update={"dataset": small}), folder, comm=MPI.COMM_SELF)
    return folder


@pytest.fixture(scope="module")
def structured(nodal: Path) -> Path:
    folder = nodal.parent / "structured"
    structure(nodal, folder)
    return folder


def joined(folder: Path, kind: str, name: str) -> np.ndarray:
    shards: list[Arrays] = [
        read_shard(path, kind)  # type: ignore[arg-type]
        for path in sorted(folder.glob("shard-*.h5"))
    ]
    return np.concatenate([shard[name] for shard in shards])


def test_both_datasets_are_intact(nodal: Path, structured: Path) -> None:
    assert check_dataset(nodal) == []
    assert check_dataset(structured) == []


def test_nodal_structured_nodal_is_exact(nodal: Path, structured: Path) -> None:
    """Equal to the last bit after the one rounding to float32."""
    shard = read_shard(structured / "shard-00000.h5", "structured")
    grid = Grid.of_nodes(shard["grid/node_at"])
    back = grid.to_nodes(joined(structured, "structured", "samples/displacement"))
    there = joined(nodal, "nodal", "samples/displacement")
    assert np.array_equal(back, there.astype(np.float32))
    force = np.concatenate(
        [nodal_forces_of(read_shard(p, "nodal")) for p in sorted(nodal.glob("shard-*.h5"))]
    )
    found = grid.to_nodes(joined(structured, "structured", "samples/force"))
    assert np.array_equal(found, force.astype(np.float32))
    assert np.all((force != 0).any(axis=2).sum(axis=1) == 1)


def test_grid_order(structured: Path) -> None:
    """x slowest, then y, lower corner first: 16 x 4 grid points 4/15 and 1/3 m apart."""
    shard = read_shard(structured / "shard-00000.h5", "structured")
    at = shard["mesh/coordinates"][shard["grid/node_at"]]
    assert at.shape == (16, 4, 2)
    assert at[:, 0, 0] == pytest.approx(np.linspace(0, 4, 16), abs=1e-9)
    assert at[3, :, 1] == pytest.approx(np.linspace(0, 1, 4), abs=1e-9)
    assert shard["samples/force"][:, :, :, :3].any() == np.False_  # loads on the upper edge only


def test_split_and_statistics(structured: Path) -> None:
    """5 % of 45 rounds to 2; statistics are those of the training split, in float64."""
    info = read_manifest(structured).structured
    assert info is not None
    is_test = joined(structured, "structured", "samples/is_test")
    assert (info.train, info.test) == (43, 2)
    assert int(is_test.sum()) == 2
    displacement = joined(structured, "structured", "samples/displacement")[~is_test]
    values = displacement.astype(np.float64).transpose(1, 0, 2, 3).reshape(2, -1)
    assert info.displacement.mean == pytest.approx(values.mean(axis=1), rel=1e-12)
    assert info.displacement.std == pytest.approx(values.std(axis=1), rel=1e-10)
    assert info.displacement.max_abs == pytest.approx(np.abs(values).max(axis=1), rel=0)


@pytest.mark.parametrize("order", ["gmsh", "random"])
def test_other_orders_are_exact_too(nodal: Path, tmp_path: Path, order: NodeOrder) -> None:
    """Other nodes on the grid points; back at the nodes the values are the same."""
    folder = tmp_path / order
    info = structure(nodal, folder, order=order, order_seed=3).structured
    assert info is not None
    assert (info.order, info.order_seed) == (order, 3)
    assert check_dataset(folder) == []
    shard = read_shard(folder / "shard-00000.h5", "structured")
    grid = Grid.of_nodes(shard["grid/node_at"])
    back = grid.to_nodes(shard["samples/displacement"])
    there = read_shard(nodal / "shard-00000.h5", "nodal")["samples/displacement"]
    assert np.array_equal(back, there.astype(np.float32))
    x = shard["mesh/coordinates"][grid.node_at]
    step = np.linalg.norm(np.diff(x, axis=0), axis=-1)
    assert step.max() > 3 * 4 / 15  # neighbours on the grid are none in space
    in_sequence = np.array_equal(grid.node_at.ravel(), np.arange(64))
    assert in_sequence == (order == "gmsh")


def test_split_is_random_and_reproducible() -> None:
    settings = read_case("beam2d").dataset
    one, other = split(settings, [], 6000), split(settings, [], 6000)
    assert np.array_equal(one, other)
    assert one.sum() == 300
    assert 0.3 < np.flatnonzero(one).mean() / 6000 < 0.7


def test_a_grown_split_keeps_every_sample_on_its_side() -> None:
    """5 % of 2000, 2100 and 5000 samples are 100, 105 and 250."""
    settings = read_case("beam2d").dataset
    first = split(settings, [], 2000)
    second = split(settings, [2000], 2100)
    third = split(settings, [2000, 2100], 5000)
    assert [int(part.sum()) for part in (first, second, third)] == [100, 105, 250]
    assert np.array_equal(second[:2000], first)
    assert np.array_equal(third[:2100], second)
    later = np.flatnonzero(third[2100:])
    assert 0.3 < later.mean() / 2900 < 0.7


@pytest.mark.parametrize(("stages", "samples"), [([1], 3), ([0, 2], 4), ([3], 3), ([2], 100)])
def test_split_of_few(stages: list[int], samples: int) -> None:
    """One sample of each split at least."""
    is_test = split(read_case("beam2d").dataset, stages, samples)
    assert 1 <= int(is_test.sum()) < samples


def test_again_changes_nothing(nodal: Path, tmp_path: Path) -> None:
    """An up-to-date dataset is left alone; a damaged or reordered one is made again."""
    folder = tmp_path / "again"
    first = structure(nodal, folder)
    shard = folder / "shard-00001.h5"
    before = shard.stat().st_mtime_ns
    assert structure(nodal, folder) == first
    assert shard.stat().st_mtime_ns == before
    shard.write_bytes(shard.read_bytes()[:-1])
    assert structure(nodal, folder).structured == first.structured
    assert check_dataset(folder) == []
    assert structure(nodal, folder, order="random", order_seed=1).structured != first.structured
    assert check_dataset(folder) == []


def test_mesh_without_order(nodal: Path, tmp_path: Path) -> None:
    """Nodes moved off their grid lines: no other order, nothing left behind; an embedded grid."""
    crooked = tmp_path / "nodal"
    crooked.mkdir()
    manifest = read_manifest(nodal, "nodal")
    entries = []
    for entry in manifest.shards:
        arrays = read_shard(nodal / entry.file, "nodal")
        x = arrays["mesh/coordinates"]
        arrays["mesh/coordinates"] = x + 0.1 * np.sin(40 * x[:, ::-1])
        digest = write_shard(crooked / entry.file, "nodal", arrays, manifest.case_digest, "quad")
        entries.append(entry.model_copy(update={"sha256": digest}))
    update = {"shards": tuple(entries), "stiffness": None}
    write_manifest(crooked, manifest.model_copy(update=update))
    with pytest.raises(InputError, match="no structured order"):
        structure(crooked, tmp_path / "grid", order="gmsh")
    assert not (tmp_path / "grid").exists()
    info = structure(crooked, tmp_path / "grid").structured
    assert info is not None
    assert info.embedding is not None
    assert check_dataset(tmp_path / "grid") == []
    row = structure(crooked, tmp_path / "row", grid="nodes").structured
    assert row is not None
    assert row.grid_shape == (len(x), 1)
    assert row.embedding is None
    assert check_dataset(tmp_path / "row") == []


def without_stiffness(nodal: Path, folder: Path) -> Path:
    """A copy as `datagen run` wrote it before it assembled the stiffness."""
    shutil.copytree(nodal, folder)
    (folder / STIFFNESS_FILE).unlink()
    write_manifest(folder, read_manifest(folder).model_copy(update={"stiffness": None}))
    return folder


def test_stiffness_is_carried_over(nodal: Path, structured: Path, tmp_path: Path) -> None:
    """The file of the nodal dataset, byte for byte, whatever the step."""
    expected = (nodal / STIFFNESS_FILE).read_bytes()
    assert (structured / STIFFNESS_FILE).read_bytes() == expected
    noisy = add_noise(nodal, tmp_path / "noisy", seed=1)
    assert noisy.stiffness == read_manifest(nodal).stiffness == sha256(nodal / STIFFNESS_FILE)
    assert (tmp_path / "noisy" / STIFFNESS_FILE).read_bytes() == expected
    made = structure(tmp_path / "noisy", tmp_path / "grid")
    assert made.stiffness is None
    assert made.stiffness_checksum == noisy.stiffness
    assert check_dataset(tmp_path / "noisy") == check_dataset(tmp_path / "grid") == []


def test_stiffness_of_an_older_dataset_is_assembled(nodal: Path, tmp_path: Path) -> None:
    """Bit for bit what `datagen run` writes now; noise leaves it out."""
    older = without_stiffness(nodal, tmp_path / "older")
    assert check_dataset(older) == []
    assert '"stiffness"' not in (older / "manifest.json").read_text()
    structure(older, tmp_path / "grid")
    expected = (nodal / STIFFNESS_FILE).read_bytes()
    assert (tmp_path / "grid" / STIFFNESS_FILE).read_bytes() == expected
    noisy = tmp_path / "noisy"
    noisy.mkdir()
    (noisy / STIFFNESS_FILE).write_bytes(b"of a step that was killed")
    assert add_noise(older, noisy, seed=1).stiffness is None
    assert not (noisy / STIFFNESS_FILE).exists()
    assert check_dataset(tmp_path / "grid") == check_dataset(noisy) == []


def test_failed_load_cases_are_counted(tmp_path: Path) -> None:
    """They have no row, but the load cases of both datasets are the same number."""
    case = read_case("beam2d", samples=20)
    load = case.loads[0].model_copy(update={"range": (-300.0, 300.0)})
    made = run(case.model_copy(update={"load": load}), tmp_path / "nodal", comm=MPI.COMM_SELF)
    assert made.failed
    found = structure(tmp_path / "nodal", tmp_path / "structured")
    assert (found.samples, found.failed) == (made.samples, made.failed)
    assert check_dataset(tmp_path / "structured") == []


def test_damaged_stiffness_is_refused(nodal: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "nodal"
    shutil.copytree(nodal, damaged)
    (damaged / STIFFNESS_FILE).write_bytes(b"")
    with pytest.raises(InputError, match=r"stiffness\.h5: empty"):
        structure(damaged, tmp_path / "new")
    (damaged / STIFFNESS_FILE).unlink()
    with pytest.raises(InputError, match=r"stiffness\.h5: no such file"):
        add_noise(damaged, tmp_path / "new", seed=0)
    assert not (tmp_path / "new").exists()


def test_refusals(nodal: Path, structured: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a structured dataset, expected a nodal one"):
        structure(structured, tmp_path / "new")
    with pytest.raises(InputError, match="no such dataset"):
        structure(tmp_path / "nothing", tmp_path / "new")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("")
    with pytest.raises(InputError, match="holds something else"):
        structure(nodal, tmp_path / "full")
    with pytest.raises(InputError, match="holds another dataset"):
        structure(nodal, nodal)
    assert not (tmp_path / "new").exists()


def test_damaged_source_is_refused(nodal: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "nodal"
    shutil.copytree(nodal, damaged)
    shard = damaged / "shard-00001.h5"
    content = bytearray(shard.read_bytes())
    content[len(content) // 2] ^= 4
    shard.write_bytes(content)
    with pytest.raises(InputError, match=r"shard-00001\.h5"):
        structure(damaged, tmp_path / "new")
    shard.write_bytes(b"")
    with pytest.raises(InputError, match="empty"):
        structure(damaged, tmp_path / "new")
    assert not (tmp_path / "new").exists()
