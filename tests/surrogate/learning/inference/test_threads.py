"""Threads that share a network, and copies of it in other processes, give the same numbers.

Every number is compared bit by bit with that of a second copy of the network that is asked by one
thread alone.
"""

from __future__ import annotations

import copy
import io
import json
import multiprocessing
import pickle
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch.utils.data import DataLoader

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.evaluation.run_evaluation import evaluate
from surrogate.learning.inference import export
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.models.kinds import run_config
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train
from surrogate.mechanics.equilibrium.kept_responses import KeptResponses
from surrogate.runtime.device import convolutions

Array = NDArray[np.float64]
THREADS, ROUNDS, PASSES = 3, 2, 4
UNET = {"levels": 2, "channels": 4, "padding": 1, "batch_norm": False}
SERIES = {"inputs": ["force", "linear_gradient", "last_gradient"], "skip": "series"}
REDUCED = {"input_modes": 6, "output_modes": 8, "width": 16, "depth": 2}
BAYES: dict[str, Any] = {"likelihood": "variational_bayes", "variational": {"initial_std": 0.05}}
MLE = {"likelihood": "maximum_likelihood"}
KINDS: dict[str, dict[str, Any]] = {
    "U-Net": {"network": UNET},
    "U-Net with dropout": {"network": {**UNET, "dropout": 0.2}},
    "U-Net, likelihood": {"network": {**UNET, **SERIES}, **MLE},
    "U-Net, Bayes": {"network": UNET, **BAYES, "ensemble": 2},
    "U-Net with series, Bayes": {"network": {**UNET, **SERIES}, **BAYES},
    "reduced": {"model": "reduced", "network": {**REDUCED, "series": [4, 3]}},
    "reduced, Bayes": {"model": "reduced", "network": REDUCED, **BAYES},
    "Gaussian process": {"model": "pod", "pod": {"regression": "gp"}, **MLE},
}


@pytest.fixture(scope="module", params=KINDS)
def run(request: pytest.FixtureRequest, data: Path, tmp_path_factory: Any) -> Path:
    """A run of every kind, with intervals and bounds; not to be changed."""
    dataset, kind = read_dataset(data), KINDS[request.param]
    training: dict[str, Any] = {"validation_fraction": 0.1, "calibration_fraction": 0.5}
    if kind.get("model") != "pod":
        optimiser = {"name": "muon", "learning_rate": 5e-3}
        training |= {"epochs": 1, "batch_size": 8, "optimiser": optimiser}
    config = {"name": "shared", "case": dataset.manifest.name, **kind, "training": training}
    folder: Path = tmp_path_factory.mktemp("threads") / "run"
    train(run_config(config), dataset, folder, device="cpu")
    evaluation = evaluate(folder, data, passes=5, conformal=0.5, certify=True)
    assert evaluation.intervals is not None
    assert evaluation.fast_certificate is not None
    files = RunFolder(folder)
    files.write_evaluation(
        {
            files.evaluation: json.dumps(evaluation.content).encode(),
            files.intervals: evaluation.intervals.serialised(),
            files.fast_certificate: evaluation.fast_certificate.serialised(),
        }
    )
    return folder


@pytest.fixture(autouse=True)
def _in_turns() -> Iterator[None]:
    """Threads take turns often; warnings of loads are of no interest here."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
    sys.setswitchinterval(before)


def leaves(value: Any) -> list[Array]:
    """Arrays and numbers in a result, in their order."""
    if isinstance(value, dict):
        return [leaf for part in value.values() for leaf in leaves(part)]
    if isinstance(value, (list, tuple)):
        return [leaf for part in value for leaf in leaves(part)]
    if isinstance(value, torch.Tensor):
        return [value.detach().numpy()]
    if isinstance(value, (np.ndarray, float, int, bool, np.generic)):
        return [np.asarray(value)]
    if hasattr(value, "__dataclass_fields__"):
        names = (name for name in value.__dataclass_fields__ if name != "geometry")
        return leaves([getattr(value, name) for name in names])
    return []


def gradient(model: Surrogate, force: Array) -> list[torch.Tensor]:
    """Displacements, and derivatives of the sum of their squares."""
    loads = torch.tensor(force, requires_grad=True)
    found = model.predict(loads)
    found.square().sum().backward()  # type: ignore[no-untyped-call]
    assert loads.grad is not None
    return [found, loads.grad]


def options(model: Surrogate, number: int) -> dict[str, Any]:
    return {"passes": PASSES, "seed": number} if model.is_stochastic else {}


CALLS: dict[str, Callable[[Surrogate, Array, int], Any]] = {
    "predict": lambda model, force, _: [model.predict(force[0]), model.predict(force)],
    "predict, driven": lambda model, force, _: model.predict(force, tolerance=1e-4),
    "predict, some nodes": lambda model, force, number: model.predict(
        force, nodes=np.arange(number, 12)
    ),
    "predict tensors": lambda model, force, _: model.predict(torch.tensor(force)),
    "gradient": lambda model, force, _: gradient(model, force[:2]),
    "predict_distribution": lambda model, force, number: [
        model.predict_distribution(part, PASSES, number)
        for part in (force[0], force)
        if model.is_probabilistic
    ],
    "averaged_passes": lambda model, force, number: model.averaged_passes(force, PASSES, number),
    "bounds": lambda model, force, _: model.bounds(force, level=0.5),
    "correct_each": lambda model, force, _: model.correct_each(force[:2]),
    "solve": lambda model, force, number: model.solve(
        force[0], certify="full", stresses=True, **options(model, number)
    ),
    "solve, fast": lambda model, force, number: model.solve(
        force[0], certify="fast", level=0.5, conformal="marginal", **options(model, number)
    ),
    "solve, corrected": lambda model, force, number: model.solve(
        force[0], correct=True, certify="full", **options(model, number)
    ),
    "certify": lambda model, force, _: model.certify(force),
    "correct": lambda model, force, _: model.correct(force[0]),
    "fast_estimate": lambda model, force, _: model.fast_estimate(force, np.zeros_like(force)),
    "fast_certificate": lambda model, force, _: model.fast_certificate.certify(
        force[0], np.zeros_like(force[0]), 0.5
    ),
    "intervals": lambda model, force, _: model.intervals.bounds("simultaneous", force, 1.0),
    "stresses": lambda model, force, _: model.stresses(1e-3 * force),
    "reactions": lambda model, force, _: model.reactions(1e-3 * force[0]),
    "training_range": lambda model, force, _: len(model.training_range.exceeded(3 * force)),
    "repr": lambda model, force, _: [ord(letter) for letter in repr(model)],
}


def loads_of(dataset: Dataset, number: int) -> Array:
    """Four loads, (4, n_nodes, d), others for every number."""
    force = dataset.nodal_test.force
    return np.asarray(force[(number + np.arange(4)) % len(force)] * (1 - 0.01 * number))


def answers(model: Surrogate, dataset: Dataset, names: list[str], number: int) -> list[Array]:
    force = loads_of(dataset, number)
    return leaves([CALLS[name](model, force, number) for name in names])


def same(found: list[Array], expected: list[Array]) -> bool:
    pairs = zip(found, expected, strict=True)
    return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def in_threads(work: Callable[[int], Any], count: int) -> list[Any]:
    """Results of 0 … count − 1, by as many threads that begin at once."""
    barrier = threading.Barrier(count)

    def one(number: int) -> Any:
        barrier.wait()
        return work(number)

    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(one, range(count)))


def test_threads_share_a_network(run: Path, dataset: Dataset) -> None:
    """Every method, in threads with other loads and seeds; caches are filled in the first round."""
    alone, shared, names = load(run), load(run), list(CALLS)
    expected = [answers(alone, dataset, names, number) for number in range(THREADS)]
    assert not same(expected[0], expected[1])
    for turn in range(ROUNDS):
        turned = [*names[8 * turn :], *names[: 8 * turn]]
        order = np.argsort([names.index(name) for name in turned])

        def work(number: int, turned: list[str] = turned) -> list[list[Array]]:
            return [answers(shared, dataset, [name], number) for name in turned]

        for found, right in zip(in_threads(work, THREADS), expected, strict=True):
            sorted_parts = [leaf for place in order for leaf in found[place]]
            assert same(sorted_parts, right)


def test_threads_mix_methods(run: Path, dataset: Dataset) -> None:
    """At one time every thread calls another method, with seeds of its own."""
    alone, shared, names = load(run), load(run), list(CALLS)
    expected = [answers(alone, dataset, [name], k) for k, name in enumerate(names)]
    found = in_threads(lambda k: answers(shared, dataset, [names[k]], k), len(names))
    for name, one, other in zip(names, found, expected, strict=True):
        assert same(one, other), name


def test_copies(run: Path, dataset: Dataset) -> None:
    """Pickles, also of used networks, copies, and files of `torch.save`; without what is kept."""
    model, names = load(run), list(CALLS)
    fresh = len(pickle.dumps(model))
    expected = answers(model, dataset, names, 1)
    pickled = pickle.dumps(model)
    assert len(pickled) < 1.2 * fresh + 1e5
    saved = io.BytesIO()
    torch.save(model, saved)
    saved.seek(0)
    for other in (
        pickle.loads(pickled),
        copy.deepcopy(model),
        torch.load(saved, weights_only=False),
    ):
        assert repr(other) == repr(model)
        assert same(answers(other, dataset, names, 1), expected)


def predicted(work: tuple[Surrogate, Array, int]) -> Array:
    """Standard deviations and means, in another process."""
    torch.set_num_threads(1)
    model, force, seed = work
    found = model.predict_distribution(force, PASSES, seed)
    return np.stack([found.mean, found.std])


class Predictions(torch.utils.data.Dataset[Array]):
    """Predictions by the workers of a `DataLoader`."""

    def __init__(self, model: Surrogate, force: Array) -> None:
        self.model, self.force = model, force

    def __len__(self) -> int:
        return len(self.force)

    def __getitem__(self, number: int) -> Array:
        return predicted((self.model, self.force[number], number))


@pytest.mark.slow
def test_spawned_workers(dataset: Dataset, tmp_path: Path) -> None:
    """A network with random weights that is passed to spawned processes and to a `DataLoader`."""
    training = {"epochs": 1, "batch_size": 8, "optimiser": {"name": "muon", "learning_rate": 5e-3}}
    content = {"name": "a", "case": dataset.manifest.name, **KINDS["U-Net with series, Bayes"]}
    model = train(
        run_config({**content, "training": training}), dataset, tmp_path / "run", device="cpu"
    )
    force = loads_of(dataset, 0)
    model.predict(force[0])
    work = [(model, f, seed) for seed, f in enumerate(force)]
    expected = [predicted(one) for one in work]
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        found = pool.map(predicted, work)
    loader = DataLoader(
        Predictions(model, force), batch_size=None, num_workers=1, multiprocessing_context="spawn"
    )
    for results in (found, [np.asarray(one) for one in loader]):
        assert all(np.array_equal(a, b) for a, b in zip(results, expected, strict=True))


@pytest.mark.slow
def test_exports_in_threads(trained_bayes: Path, tmp_path: Path) -> None:
    """Two files at once, with passes of other seeds."""
    model = load(trained_bayes)
    force = np.zeros((1, *model.geometry.coordinates.shape))
    force[0, np.flatnonzero(model.geometry.loadable)[0]] = 1.0

    files = [tmp_path / "0.pt2", tmp_path / "1.pt2"]

    def work(number: int) -> None:
        export.export(trained_bayes, files[number], format="pt2", passes=2, seed=number)

    in_threads(work, 2)
    for number, file in enumerate(files):
        fields = export.load_exported(file)(torch.from_numpy(force).float())
        found, expected = fields["displacement"], model.predict_distribution(force, 2, number).mean
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4 * np.abs(expected).max())


def test_columns_are_kept_once() -> None:
    """Threads that ask for columns before any is kept get them all; a copy keeps none."""
    calls: list[int] = []

    def respond(unit: Array) -> Array:
        calls.append(len(unit))
        threading.Event().wait(0.01)
        return 2.0 * unit

    columns = KeptResponses(respond, 12)
    numbers = [np.array([k, (k + 1) % 12]) for k in range(THREADS)]
    weights = np.array([1, 3], np.float32)
    found = in_threads(lambda k: columns.sum_of(numbers[k], weights), THREADS)
    for one, total in zip(numbers, found, strict=True):
        assert np.array_equal(total, 2 * weights @ np.eye(12)[one])
    assert sum(calls) == THREADS + 1


def test_precision_of_threads() -> None:
    """The last thread to leave restores the setting, whichever was first to enter."""
    before = torch.backends.cudnn.allow_tf32
    torch.backends.cudnn.allow_tf32 = True
    first, second = convolutions("float32"), convolutions("float32")
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert not torch.backends.cudnn.allow_tf32
    with convolutions("tensorfloat32"):
        assert torch.backends.cudnn.allow_tf32
    assert not torch.backends.cudnn.allow_tf32
    second.__exit__(None, None, None)
    assert torch.backends.cudnn.allow_tf32
    torch.backends.cudnn.allow_tf32 = before
