"""A training step as one CUDA graph.

A step of a small batch is hundreds of kernels of microseconds each, and launching them one by one
takes longer than they do. Captured once, they are launched together.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from surrogate.data.dataset import Samples

WARM_UP = 3  # steps before the capture, in which libraries and optimisers allocate what they need


def can_capture(device: torch.device, processes: int) -> bool:
    """Tell whether steps can be captured: on a GPU, by one process."""
    return device.type == "cuda" and processes == 1


class CapturedStep:
    """A step that is replayed; the first few, which are as good, run one kernel after another.

    Parameters
    ----------
    step : callable
        From a batch, always of one size, to a tensor. Everything else that it reads, the learning
        rate above all, is in tensors that stay where they are. Its random numbers are those of the
        default generator, which every replay takes further.
    """

    def __init__(self, step: Callable[[Samples], Tensor]) -> None:
        self._step = step
        self._stream = torch.cuda.Stream()  # type: ignore[no-untyped-call]
        self._steps = 0
        self._graph: torch.cuda.CUDAGraph | None = None
        self._batch: Samples
        self._result: Tensor

    def __call__(self, samples: Samples) -> Tensor:
        """Do the step; the result is overwritten by the next."""
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
        """Run on the stream of the capture, as autograd remembers the streams of parameters."""
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
