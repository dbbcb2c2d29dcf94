"""A training step as one CUDA graph.

A step of a small batch is hundreds of kernels of microseconds each; launching them one by one
takes longer than running them. Captured once as a graph, they are launched together.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from surrogate.data.dataset import Samples

WARM_UP = 3  # steps before the capture, in which libraries and optimisers allocate what they need


def can_capture(device: torch.device, processes: int) -> bool:
    """Return True if steps can be captured: on a GPU, in one process."""
    return device.type == "cuda" and processes == 1


class CapturedStep:
    """A step that is replayed; the first few run one kernel after another, with the same result.

    Parameters
    ----------
    step : callable
        Function from a batch, always of one size, to a tensor. Everything else that it reads, such
        as the learning rate, is in tensors whose memory does not move. Its random numbers are those
        of the default generator, which every replay advances.
    """

    def __init__(self, step: Callable[[Samples], Tensor]) -> None:
        self._step = step
        self._stream = torch.cuda.Stream()  # type: ignore[no-untyped-call]
        self._steps = 0
        self._graph: torch.cuda.CUDAGraph | None = None
        self._batch: Samples
        self._result: Tensor

    def __call__(self, samples: Samples) -> Tensor:
        """Do the step; the next step overwrites the result."""
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
        """Run on the capture's stream, because autograd remembers the streams of parameters."""
        current = torch.cuda.current_stream()
        self._stream.wait_stream(current)
        with torch.cuda.stream(self._stream):
            result = self._step(samples)
        current.wait_stream(self._stream)
        return result

    def _capture(self, samples: Samples) -> torch.cuda.CUDAGraph:
        """Record the step's kernels, without running them."""
        self._batch = Samples(samples.force.clone(), samples.displacement.clone())
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph, stream=self._stream):
            self._result = self._step(self._batch)
        return graph
