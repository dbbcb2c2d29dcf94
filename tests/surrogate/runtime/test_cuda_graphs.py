"""Work on a GPU as CUDA graphs: the same results as by single launches, and as on the CPU."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from surrogate import load
from surrogate.learning.inference.calibration import drawn_loads
from surrogate.mechanics.series.series_response import SeriesResponse
from surrogate.runtime.cuda_graphs import Replayed


def test_on_a_cpu_the_function_itself() -> None:
    def negative(x: torch.Tensor) -> tuple[torch.Tensor]:
        return (-x,)

    (found,) = Replayed(negative)(torch.ones(3))
    assert found.tolist() == [-1, -1, -1]


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_replayed_function() -> None:
    """For more shapes than are kept, in and out of inference mode; results are not overwritten."""
    calls = []

    def work(x: torch.Tensor, y: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        calls.append(x.shape)
        return x @ y, x.sum(0)

    replayed = Replayed(work, most=2)
    found = []
    for size in (1, 2, 3, 3, 1):
        with torch.inference_mode(size == 2):
            x, y = (torch.randn(size, size, device="cuda") for _ in range(2))
            found.append((replayed(x, y), work(x, y)))
    for one, other in found:
        assert all(torch.allclose(a, b) for a, b in zip(one, other, strict=True))
    assert len(calls) == 5 + 4 * 4  # warm-up and capture of sizes 1, 2, 3, and of 1 again


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("name", ["beam2d_any", "beam3d_any", "beam3d_any_reduced"])
def test_networks_of_the_package(name: str) -> None:
    """Predictions and their derivatives; few loads and many."""
    on_gpu, on_cpu = load(name, "cuda"), load(name)
    forces = drawn_loads(on_cpu, 20, np.random.default_rng(0))
    if isinstance(on_cpu.network.linear, SeriesResponse):
        on_cpu.network.linear.series.compiled = False  # Numba takes longer to compile than all else
    expected = on_cpu.averaged_passes(forces).mean
    size = np.abs(expected).max(axis=(1, 2), keepdims=True)
    close = 1e-3 if name == "beam3d_any" else 1e-4  # series in single precision
    for some in (slice(0, 1), slice(3, 5), slice(0, 20)):
        found = on_gpu.predict(forces[some])
        assert np.median(np.abs(found - expected[some]) / size[some]) < close
    if name == "beam3d_any_reduced":
        gradients = []
        for model in (on_gpu, on_cpu):
            force = torch.from_numpy(forces[:2]).requires_grad_(True)
            displacement = model.predict(force.to(model.network.free.device))
            displacement.square().sum().backward()  # type: ignore[no-untyped-call]
            gradients.append(force.grad)
        a, b = (torch.as_tensor(gradient) for gradient in gradients)
        assert (a - b).norm() < 1e-3 * b.norm()
