"""Work on the device as one CUDA graph; on a CPU, for rehearsals, the work itself."""

from __future__ import annotations

from collections.abc import Callable

import torch

WARM_UP = 3


def captured(work: Callable[[], object], device: torch.device) -> Callable[[], object]:
    """Capture some work on tensors at fixed addresses; return the function that repeats it."""
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
