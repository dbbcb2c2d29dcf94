"""Step: the time of a prediction, NumPy arrays in and out, for batches of 1 to 4096 loads.

Networks have random weights. Loads are predicted by `Surrogate.averaged_passes`, up to 16 of them
by one CUDA graph, in float32 and with TF32 convolutions; and one load by the network compiled by
`torch.compile`. Networks of variational Bayes make 300 passes with weights that are kept on the
device.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.framework.experiment import Findings
from experiments.gpu.setting import CASES, GpuSetting, Results
from experiments.measures.latency import by_compiling
from experiments.measures.untrained import LIKELIHOODS, RECIPES, shape_of, untrained
from surrogate import Dataset, Surrogate, load
from surrogate.learning.networks import parameter_count
from surrogate.learning.probabilistic import PASSES, Likelihood
from surrogate.runtime.device import Precision

BATCHES = (1, 4, 16, 64, 256, 1024, 4096)
LARGEST_IN_SPACE = 256
COMPILING = 30.0  # s that compiling one network may take
PRECISIONS: tuple[Precision, ...] = ("float32", "tensorfloat32")

Array = NDArray[np.float64]


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
    shape = shape_of(recipe, dataset.geometry.dimension)
    if setting.small:
        shape = shape.model_copy(update={"channels": 4})
    with tempfile.TemporaryDirectory() as folder:
        run = untrained(dataset, recipe, likelihood, Path(folder) / "run", shape)
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
    """Times of one batch in ms by precision, and how far rounded convolutions are from others."""
    result: Results = {}
    count, predicted = passes or 1, {}
    for precision in PRECISIONS:
        model.precision = precision
        predicted[precision] = model.averaged_passes(forces, count).mean
        work = partial(model.averaged_passes, forces, count)
        result[f"{precision}_ms"] = setting.milliseconds(work)
    exact, rounded = (predicted[precision] for precision in PRECISIONS)
    result["relative_difference"] = float(np.abs(rounded - exact).max() / np.abs(exact).max())
    return result


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
