"""Step: the time of a prediction, NumPy arrays in and out, for batches of 1 to 4096 loads.

Networks have random weights. *Predict* is `Surrogate.averaged_passes`, where up to 16 loads are one
CUDA graph; *graph* is the same function as a graph of its own with pinned memory on the host's
side, in float32 and with TF32 convolutions; *compiled* is by `torch.compile`. Networks of
variational Bayes make 300 passes with weights that are kept on the device.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from experiments.framework.experiment import Findings
from experiments.gpu.setting import CASES, GpuSetting, Results
from experiments.measures.latency import Work, by_compiling
from experiments.measures.untrained import LIKELIHOODS, RECIPES, Body, shape_of, untrained
from surrogate import Dataset, Surrogate, load
from surrogate.cuda_graphs import captured
from surrogate.device import Precision, convolutions
from surrogate.inference import NodalFunction
from surrogate.networks import parameter_count
from surrogate.probabilistic import PASSES, Likelihood

BATCHES = (1, 4, 16, 64, 256, 1024, 4096)
LARGEST_IN_SPACE = 256
COMPILING = 30.0  # s that compiling one network may take
GRAPH_PRECISIONS: tuple[Precision, ...] = ("float32", "tensorfloat32")

Array = NDArray[np.float64]


class GraphPrediction:
    """A prediction for a fixed number of loads, as one CUDA graph.

    Parameters
    ----------
    model : Surrogate
    samples : int
    passes : int, optional
        Number of passes; None for a network that is not stochastic.
    precision : Precision
        Precision of the convolutions.
    """

    def __init__(
        self, model: Surrogate, samples: int, passes: int | None, precision: Precision
    ) -> None:
        self.device = model.network.free.device
        on_gpu = self.device.type == "cuda"
        shape = (samples, *model.geometry.coordinates.shape)
        if passes is not None:
            model.passes.fix(0, range(passes))
        function = NodalFunction(model.nodal_network, passes).eval()
        self.sent = torch.zeros(shape, pin_memory=on_gpu)
        self.received = torch.zeros(shape, pin_memory=on_gpu)
        self.force = torch.zeros(shape, device=self.device)
        self.result = torch.zeros(shape, device=self.device)

        @torch.no_grad()
        def work() -> None:
            with convolutions(precision):
                self.result.copy_(function(self.force)["displacement"])

        self.replay = captured(work, self.device)

    def __call__(self, forces: Array) -> Array:
        """Predict displacements in m from forces in N, both (N, n_nodes, d)."""
        self.sent.copy_(torch.from_numpy(forces))
        self.force.copy_(self.sent, non_blocking=True)
        self.replay()
        self.received.copy_(self.result, non_blocking=True)
        if self.device.type == "cuda":
            torch.cuda.synchronize(self.device)
        return self.received.numpy().astype(np.float64)


def latency(setting: GpuSetting) -> Findings:
    """Time all networks; those for which there is no time are left out."""
    found: list[Results] = []
    datasets = {case: setting.dataset(case) for case in CASES}
    networks = [
        (datasets[case], recipe, likelihood)
        for likelihood, case, recipe in product(LIKELIHOODS[::-1], CASES, RECIPES)
        if likelihood == "deterministic" or not case.endswith("3d")
    ]
    for network in networks:
        if setting.seconds_left < 5:
            return Findings(numbers={"latencies": found, "complete": False})
        found += of_network(setting, *network)
    for network in networks if setting.on_gpu else ():
        if setting.seconds_left > COMPILING:
            found.append(compiled(setting, *network))
    return Findings(numbers={"latencies": found, "complete": True})


def make(
    setting: GpuSetting, dataset: Dataset, recipe: str, likelihood: Likelihood
) -> tuple[Surrogate, int | None, Results]:
    """Make a network; return it with its number of passes and its description."""
    body = Body(dataset.manifest, dataset.geometry, dataset.nodal_test.force[:1], np.nan)
    shape = shape_of(recipe, dataset.geometry.dimension)
    if setting.small:
        shape = shape.model_copy(update={"channels": 4})
    with tempfile.TemporaryDirectory() as folder:
        run = untrained(body, recipe, likelihood, Path(folder) / "run", shape)
        model = load(run.folder, setting.device.type)
    passes = (3 if setting.small else PASSES) if model.is_stochastic else None
    described: Results = {
        "case": dataset.manifest.name,
        "recipe": recipe,
        "likelihood": likelihood,
        "parameters": parameter_count(model.network),
        "passes": passes or 1,
    }
    return model, passes, described


def of_network(
    setting: GpuSetting, dataset: Dataset, recipe: str, likelihood: Likelihood
) -> Iterator[Results]:
    """Yield the times of one network for every number of loads."""
    model, passes, described = make(setting, dataset, recipe, likelihood)
    for batch in batches(setting, dataset.geometry.dimension, passes):
        if setting.seconds_left < 2:
            return
        yield {**described, "batch": batch, **ways(setting, model, loads(dataset, batch), passes)}


def compiled(setting: GpuSetting, dataset: Dataset, recipe: str, likelihood: Likelihood) -> Results:
    """Time one load by the compiled network."""
    model, passes, described = make(setting, dataset, recipe, likelihood)
    work = by_compiling(model, passes, loads(dataset, 1))
    return {**described, "batch": 1, "compiled_ms": setting.milliseconds(work)}


def ways(setting: GpuSetting, model: Surrogate, forces: Array, passes: int | None) -> Results:
    """Times of one batch in ms, and how far the graphs' results are from the eager ones."""
    result: Results = {}
    expected = model.averaged_passes(forces, passes or 1).mean
    result["predict_ms"] = setting.milliseconds(lambda: model.averaged_passes(forces, passes or 1))
    for precision in GRAPH_PRECISIONS:
        predict = GraphPrediction(model, len(forces), passes, precision)
        difference = np.abs(predict(forces) - expected).max() / np.abs(expected).max()
        name = f"graph_{precision}"
        result[f"{name}_relative_difference"] = float(difference)
        result[f"{name}_ms"] = setting.milliseconds(partial(predict, forces))
        replays = 2 if setting.small else 20
        each = setting.milliseconds(repeated(setting, predict, replays), 5) / replays
        result[f"{name}_device_ms"] = round(each, 5)
    return result


def repeated(setting: GpuSetting, predict: GraphPrediction, replays: int) -> Work:
    """Make a function that replays many times and then waits: the time without the host's."""

    def work() -> None:
        for _ in range(replays):
            predict.replay()
        setting.wait()

    return work


def batches(setting: GpuSetting, dimension: int, passes: int | None) -> tuple[int, ...]:
    """Numbers of loads in a batch; one load if there are many passes."""
    if passes is not None:
        return (1,)
    if setting.small:
        return (1, 4)
    return tuple(b for b in BATCHES if dimension == 2 or b <= LARGEST_IN_SPACE)


def loads(dataset: Dataset, count: int) -> Array:
    """Repeat the test loads up to a number, (count, n_nodes, d)."""
    force = dataset.nodal_test.force
    return force[np.arange(count) % len(force)]
