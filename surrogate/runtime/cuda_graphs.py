"""Work on a GPU as one CUDA graph: a single launch for all of its kernels.

Hundreds of kernels that run for microseconds each take longer to launch than to run.
"""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock

import torch
from torch import Tensor

__all__ = ["Replayed", "captured"]

WARM_UP = 3


def captured(work: Callable[[], object], device: torch.device) -> Callable[[], object]:
    """Capture some work on tensors at fixed addresses; return the function that repeats it.

    On a CPU, for rehearsals, this is the work itself.
    """
    if device.type != "cuda":
        work()
        return work
    stream = torch.cuda.Stream(device)  # type: ignore[no-untyped-call]
    stream.wait_stream(torch.cuda.current_stream(device))
    with torch.cuda.stream(stream):
        for _ in range(WARM_UP):
            work()
    torch.cuda.current_stream(device).wait_stream(stream)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        work()
    return graph.replay


class Replayed:
    """A function of tensors on a GPU, as one graph for every shape of theirs.

    On a CPU, inside of another capture, and where gradients are needed, it is the function itself.

    Parameters
    ----------
    function : callable
        Tensors to a tuple of tensors; all else that it reads stays at its place. It does not wait
        for the device.
    most : int
        Number of graphs that are kept.
    """

    def __init__(self, function: Callable[..., tuple[Tensor, ...]], most: int = 4) -> None:
        self._function, self._most = function, most
        self._graphs: dict[tuple[torch.Size, ...], _Graph] = {}
        self._lock = Lock()

    def __call__(self, *given: Tensor) -> tuple[Tensor, ...]:
        """Evaluate."""
        is_itself = given[0].device.type != "cuda" or torch.cuda.is_current_stream_capturing()
        if is_itself or any(each.requires_grad for each in given):
            return self._function(*given)
        shapes = tuple(each.shape for each in given)
        with self._lock, torch.inference_mode(False), torch.no_grad():
            if shapes not in self._graphs:
                if len(self._graphs) == self._most:
                    del self._graphs[next(iter(self._graphs))]
                self._graphs[shapes] = _Graph(self._function, given)
            return self._graphs[shapes](given)

    def __reduce__(self) -> tuple[type[Replayed], tuple[object, ...]]:
        return Replayed, (self._function, self._most)  # without graphs


class _Graph:
    """The function at fixed addresses."""

    def __init__(
        self, function: Callable[..., tuple[Tensor, ...]], given: tuple[Tensor, ...]
    ) -> None:
        self._held = [torch.empty_like(each).copy_(each) for each in given]
        self._found: tuple[Tensor, ...] = ()

        def work() -> None:
            self._found = function(*self._held)

        self._replay = captured(work, given[0].device)

    def __call__(self, given: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
        for held, each in zip(self._held, given, strict=True):
            held.copy_(each)
        self._replay()
        return tuple(found.clone() for found in self._found)
