"""Work on a GPU as one CUDA graph: a single launch for all of its kernels.

Hundreds of kernels that run for microseconds each take longer to launch than to run.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

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
    """A function of one tensor, as one graph for every shape that it is given.

    Parameters
    ----------
    function : callable
        Its other inputs do not change.
    """

    def __init__(self, function: Callable[[Tensor], Tensor]) -> None:
        self._function = function
        self._graphs: dict[torch.Size, tuple[Tensor, list[Tensor], Callable[[], object]]] = {}

    @torch.no_grad()
    def __call__(self, given: Tensor) -> Tensor:
        """Evaluate."""
        if given.shape not in self._graphs:
            held, result = given.clone(), list[Tensor]()

            def work() -> None:
                result[:] = [self._function(held)]

            self._graphs[given.shape] = held, result, captured(work, given.device)
        held, result, replay = self._graphs[given.shape]
        held.copy_(given)
        replay()
        return result[0].clone()
