"""Samples that the learner makes: their loads, equilibria and files; killed, resumed and grown."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import surrogate
from shared_schema.checker import check_dataset
from shared_schema.common.errors import InputError, StoppedError, WorkError
from shared_schema.dataset_reader import DatasetReader
from shared_schema.layout import Arrays
from shared_schema.loads import generator
from shared_schema.manifest import read_manifest
from shared_schema.samples.journal import Interruption, Journal
from shared_schema.samples.results import Result
from surrogate.mechanics.certify.correction import Correction, correct
from surrogate.mechanics.descent import equilibria
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.sampling import sampled_body, sampling
from surrogate.mechanics.sampling.sampled_body import SampledBody
from surrogate.mechanics.statics.body import Body
from tests.surrogate.conftest import build

NAMES = ("number", "loaded_nodes", "force", "displacement", "residual_norm", "stable")
LOAD = {"family": "random_node", "range": [-2.5, 2.5], "region": {"x": "> 0", "y": 1.5}}
SHARDS = {"samples": 60, "seed": 7, "shard_size": 4}


@pytest.fixture(scope="module")
def beam(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of a beam of 7 × 3 elements; samples are drawn four a shard."""
    return build(tmp_path_factory.mktemp("beam"), dataset=SHARDS, load=LOAD)


def samples(folder: Path) -> Arrays:
    names = [f"samples/{name}" for name in NAMES]
    return DatasetReader(folder, "nodal").joined(names)


def assert_same(one: Path, other: Path) -> None:
    """To rounding: solves for several loads at once sum in another order."""
    a, b = samples(one), samples(other)
    for name in a:
        assert np.allclose(a[name], b[name], rtol=0, atol=1e-8), name


def test_loads_are_drawn_and_in_equilibrium(beam: Path, tmp_path: Path) -> None:
    """Forces are of seed and number; Newton's method finds the same equilibria."""
    manifest = surrogate.sample(beam, tmp_path / "nodal", 10)
    assert check_dataset(tmp_path / "nodal") == []
    assert (manifest.samples, manifest.failed, len(manifest.shards)) == (10, 0, 3)
    assert next(iter(manifest.software)) == "surrogate"
    found, body = samples(tmp_path / "nodal"), Body.read(beam)
    for row in range(10):
        node = found["samples/loaded_nodes"][row, 0]
        assert body.geometry.loadable[node]
        force = generator(7, row).uniform(-2.5, 2.5, 2)
        assert np.array_equal(found["samples/force"][row, 0], force)
        load = np.zeros(body.geometry.coordinates.shape)
        load[node] = force
        exact = correct(body.equilibrium, load, np.zeros_like(load), 1e-12).displacement
        u = found["samples/displacement"][row]
        assert np.abs(u - exact).max() < 1e-8 * np.abs(exact).max()


@pytest.mark.parametrize("element", ["linear", "incompressible"])
def test_bodies_leave_the_memory_at_once(tmp_path: Path, element: str) -> None:
    """Their parts do not refer to each other, so that those of many shapes are not kept."""
    sampled = SampledBody.read(build(tmp_path, dataset=SHARDS, load=LOAD, element=element), 3)
    assert len(list(sampled.solved(range(3)))) == 3
    of = sampled.body.equilibrium
    parts = [weakref.ref(each) for each in (sampled.body, of, of.solid, of.layout)]
    gc.disable()
    try:
        del sampled, of
        assert [part() for part in parts] == [None] * len(parts)
    finally:
        gc.enable()


def test_growth_changes_nothing(beam: Path, tmp_path: Path) -> None:
    for count in (6, 10):
        surrogate.sample(beam, tmp_path / "grown", count)
    surrogate.sample(beam, tmp_path / "whole", 10)
    assert_same(tmp_path / "grown", tmp_path / "whole")
    assert check_dataset(tmp_path / "grown") == []
    assert [stage.samples for stage in read_manifest(tmp_path / "grown").history] == [6]


@pytest.mark.slow
def test_workers(beam: Path, tmp_path: Path) -> None:
    for workers in (1, 2):
        surrogate.sample(beam, tmp_path / str(workers), 70, workers=workers)
    assert_same(tmp_path / "1", tmp_path / "2")


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
def test_killed_and_resumed(
    beam: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type[BaseException]
) -> None:
    """What is solved is not solved again, in finished shards and in those that are not."""
    monkeypatch.setattr(sampling, "AT_A_TIME", 3)
    solve, seen = SampledBody.solved, []

    def solved(self: SampledBody, numbers: Sequence[int]) -> Iterator[Result]:
        for result in solve(self, numbers):
            seen.append(result.number)
            if len(seen) == 9:
                raise error
            yield result

    monkeypatch.setattr(SampledBody, "solved", solved)
    with pytest.raises(error):
        surrogate.sample(beam, tmp_path / "nodal", 12)
    assert not (tmp_path / "nodal" / "manifest.json").exists()
    assert (tmp_path / "nodal" / ".journal" / "shard-00000.json").exists()
    kept = (tmp_path / "nodal" / "shard-00000.h5").stat().st_mtime_ns
    surrogate.sample(beam, tmp_path / "nodal", 12)
    assert (tmp_path / "nodal" / "shard-00000.h5").stat().st_mtime_ns == kept
    assert {seen.count(number) for number in range(7)} == {1}
    monkeypatch.undo()
    surrogate.sample(beam, tmp_path / "whole", 12)
    assert_same(tmp_path / "nodal", tmp_path / "whole")


def test_stopped(beam: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sampling, "AT_A_TIME", 3)

    def asked(self: Interruption) -> Interruption:
        self.asked = True
        return self

    monkeypatch.setattr(Interruption, "__enter__", asked)
    with pytest.raises(StoppedError):
        surrogate.sample(beam, tmp_path / "nodal", 12)
    monkeypatch.undo()
    assert surrogate.sample(beam, tmp_path / "nodal", 12).samples == 12


def test_where_directions_end_a_correction_goes_on(
    beam: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(equilibria, "MOST", 2)
    surrogate.sample(beam, tmp_path / "corrected", 6)
    monkeypatch.undo()
    surrogate.sample(beam, tmp_path / "driven", 6)
    assert_same(tmp_path / "corrected", tmp_path / "driven")


def test_failed_samples_are_recorded(
    beam: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def under_small_loads(equilibrium: Equilibrium, force: Any, *others: Any) -> Correction:
        if np.abs(force).max() > most:
            raise WorkError("no equilibrium")
        return correct(equilibrium, force, *others)

    most = 2.0
    monkeypatch.setattr(equilibria, "MOST", 0)
    monkeypatch.setattr(sampled_body, "correct", under_small_loads)
    manifest = surrogate.sample(beam, tmp_path / "nodal", 12)
    large = sum(np.abs(generator(7, n).uniform(-2.5, 2.5, 2)).max() > most for n in range(12))
    assert (manifest.samples, manifest.failed) == (12 - large, large)
    assert 0 < large < 12
    reasons = DatasetReader(tmp_path / "nodal").joined(["failed/reason"])["failed/reason"]
    assert set(map(str, reasons)) == {"no equilibrium"}
    most = 0.0
    with pytest.raises(WorkError, match="none of the 3 load cases has an equilibrium"):
        surrogate.sample(beam, tmp_path / "none", 3)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"load": {"family": "tool", "radius": 0.2, "depth": [0, 0.1]}}, "expected forces and"),
        ({"load": {"family": "mine.py:Mine"}}, "key 'load'"),
        ({"solver": {"stability": "fail"}}, "key 'solver.stability' = 'fail'"),
    ],
)
def test_wrong_bodies(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    wrong = build(tmp_path / "wrong", dataset=SHARDS, **changes)
    with pytest.raises(InputError, match=said):
        surrogate.sample(wrong, tmp_path / "nodal", 4)
    assert not (tmp_path / "nodal").exists()


def test_other_samples_are_left_alone(beam: Path, tmp_path: Path) -> None:
    surrogate.sample(beam, tmp_path / "nodal", 4)
    with pytest.raises(InputError, match=r"dataset\.seed = 8"):
        surrogate.sample(beam, tmp_path / "nodal", 4, seed=8)
    journal = Journal(tmp_path / "of the factory", SampledBody.read(beam, 4).case, "datagen run")
    journal.open()
    journal.close()
    with pytest.raises(InputError, match="`datagen run` makes these samples"):
        surrogate.sample(beam, tmp_path / "of the factory", 4)


def test_stiffness_is_that_of_the_elements(beam: Path) -> None:
    """K(0) u, in the rows of free components, are the forces whose linear response is u."""
    body = SampledBody.read(beam, 4)
    k, free = body.stiffness, body.body.equilibrium.free
    assert k is not None
    force = np.random.default_rng(0).normal(size=free.shape) * free
    u = body.body.equilibrium.linear_response(force[None])[0]
    rows = np.repeat(np.arange(free.size), np.diff(k.indptr))
    found = np.bincount(rows, k.data * u.ravel()[k.indices], free.size).reshape(free.shape)
    assert np.allclose(found * free, force, atol=1e-9)
