"""A training step that takes less time: as one CUDA graph, or compiled by `torch.compile`.

A step on a small batch launches hundreds of kernels that run for microseconds each. Launching them
one by one takes longer than running them. A CUDA graph, captured once, launches all of them
together.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from shared_schema.common.errors import WorkError, first_line
from surrogate.learning.data.samples import Samples
from surrogate.learning.probabilistic.likelihoods import Prediction

WARM_UP = 3  # steps before the capture, in which libraries and optimisers allocate what they need


def can_capture(device: torch.device, processes: int) -> bool:
    """Return True if steps can be captured: on a GPU, in one process."""
    return device.type == "cuda" and processes == 1


class CapturedStep:
    """A training step that is captured once and then replayed.

    The first few steps run without a graph; their results are the same.

    Parameters
    ----------
    step : callable
        Function that maps a batch to a tensor. All batches have the same size. All other inputs,
        such as the learning rate, are tensors at fixed memory addresses. Random numbers come from
        the default generator, which every replay advances.
    """

    def __init__(self, step: Callable[[Samples], Tensor]) -> None:
        self._step = step
        self._stream = torch.cuda.Stream()  # type: ignore[no-untyped-call]
        self._steps = 0
        self._graph: torch.cuda.CUDAGraph | None = None
        self._batch: Samples
        self._result: Tensor

    def __call__(self, samples: Samples) -> Tensor:
        """Run the step; the next step overwrites the returned tensor."""
        self._steps += 1
        if self._steps <= WARM_UP:
            return self._run_aside(samples)
        if self._graph is None:
            self._graph = self._capture(samples)
        self._batch.force.copy_(samples.force)
        self._batch.displacement.copy_(samples.displacement)
        self._graph.replay()
        return self._result

    def _run_aside(self, samples: Samples) -> Tensor:
        """Run without a graph on the capture's stream: autograd keeps the streams of parameters."""
        current = torch.cuda.current_stream()
        self._stream.wait_stream(current)
        with torch.cuda.stream(self._stream):
            result = self._step(samples)
        current.wait_stream(self._stream)
        return result

    def _capture(self, samples: Samples) -> torch.cuda.CUDAGraph:
        """Record the kernels of the step without running them."""
        self._batch = Samples(samples.force.clone(), samples.displacement.clone())
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph, stream=self._stream):
            self._result = self._step(self._batch)
        return graph


def compiled(network: Callable[[Tensor], Prediction]) -> Callable[[Tensor], Prediction]:
    """Compile the map of a network, once for every shape of its input.

    The returned function raises WorkError if compilation fails, for instance because there is no
    C++ compiler.
    """
    from torch._dynamo.exc import TorchDynamoException

    fast = torch.compile(network, dynamic=False)

    def forward(force: Tensor) -> Prediction:
        try:
            return fast(force)
        except TorchDynamoException as error:
            raise WorkError(f"key 'training.compile' = True: {first_line(error)}") from None

    return forward
