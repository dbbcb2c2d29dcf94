"""Ways to predict one load with a network, and their times."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from experiments.framework.timing import TIMING, Timing, median_seconds
from surrogate import Surrogate, export
from surrogate.learning.inference import NodalFunction

Array = NDArray[np.float64]
Work = Callable[[], object]
Predict = Callable[[Array], object]


def prediction_seconds(
    surrogate: Surrogate,
    force: Array,
    passes: int = 1,
    timing: Timing = TIMING,
    drawn_anew: bool = False,
) -> float:
    """Median time of predicting one load in s, NumPy arrays in and out.

    Parameters
    ----------
    surrogate : Surrogate
    force : array, (n_nodes, d)
        Nodal forces in N.
    passes : int
        Number of passes T.
    timing : Timing
    drawn_anew : bool
        Draw the weights of the passes for every prediction. Otherwise the weights of the
        prediction before are kept as far as they fit into memory.
    """
    predict = prediction(surrogate, force, passes)

    def predict_anew() -> None:
        surrogate.predictor.passes.forget()
        predict()

    return median_seconds(predict_anew if drawn_anew else predict, timing)


def prediction(surrogate: Surrogate, force: Array, passes: int) -> Callable[[], object]:
    """Make a function that predicts one load, (n_nodes, d) in N, by the fastest way."""
    if surrogate.is_probabilistic:
        return partial(surrogate.predict_distribution, force, passes)
    return partial(surrogate.predict, force)


def by_pytorch(model: Surrogate) -> Predict:
    """Make a function that predicts forces (N, n_nodes, d) with the network in PyTorch."""
    device = model.network.free.device

    @torch.inference_mode()
    def predict(force: Array) -> Array:
        single = torch.from_numpy(force.astype(np.float32)).to(device)
        mean = model.predictor.network(single).mean.mean(dim=0)
        return np.asarray(mean.double().cpu().numpy())

    return predict


def by_compiling(model: Surrogate, passes: int | None, force: Array) -> Work:
    """Make a function that predicts with the network compiled by `torch.compile`."""
    function = NodalFunction(model.predictor.network, passes)
    device = model.network.free.device
    if passes is None:
        model.predictor.passes.forget()
    else:
        model.predictor.passes.fix(0, range(passes))
    fast = torch.compile(function, mode="reduce-overhead" if device.type == "cuda" else "default")
    single = force.astype(np.float32)

    @torch.no_grad()
    def work() -> Array:
        fields = fast(torch.from_numpy(single).to(device))
        return np.asarray(fields["displacement"].cpu().numpy())

    return work


def by_onnx(run: Path, file: Path, passes: int | None = None) -> Predict:
    """Make a function that predicts forces (N, n_nodes, d) with an exported file, in ONNX Runtime.

    It uses as many threads as PyTorch.

    Parameters
    ----------
    run : Path
        Run folder.
    file : Path
        ONNX file to write.
    passes : int, optional
        Number of passes of a stochastic network.
    """
    import onnxruntime

    export(run, file, format="onnx", passes=passes)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads()
    session = onnxruntime.InferenceSession(file, options, providers=["CPUExecutionProvider"])
    return lambda force: session.run(["displacement"], {"force": force.astype(np.float32)})
