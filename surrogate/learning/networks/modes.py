"""Leading modes of fields on the grid, and the scales of their coefficients as inputs."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from surrogate.learning.networks.grid_fields import at_points, on_grid

LARGEST_SVD = 2000  # samples; of more, a random part is decomposed
POWER_ITERATIONS, SPARE_MODES = 4, 20


def chosen_rows(count: int, seed: int, largest: int) -> Tensor:
    """Return random rows of some samples, `largest` at most, sorted."""
    generator = torch.Generator().manual_seed(seed)
    return torch.randperm(count, generator=generator)[:largest].sort().values


def modal_encoder(
    respond: Callable[[Tensor], Tensor],
    linear: Tensor,
    points: Tensor,
    count: int,
    force_scale: Tensor,
    seed: int,
) -> Tensor:
    """Return (S Φ)ᵀ of the leading modes Φ of linear responses, (count, d · n_points), scaled.

    It takes scaled forces at the points to scaled coefficients (`half_whitening`).

    Parameters
    ----------
    respond : callable
        Linear response S on the grid: forces in N to displacements in m.
    linear : Tensor, (N, d, nx, ny[, nz])
        Linear responses of the training samples, in m.
    points : Tensor of int, (n_points,)
        Numbers of the points, in the flattened grid, that are nodes and not clamped.
    count : int
        Number of modes.
    force_scale : Tensor, ()
        Unit of the scaled forces, in N.
    seed : int
    """
    snapshots = at_points(linear[chosen_rows(len(linear), seed, LARGEST_SVD)], points)
    modes = leading_modes(snapshots, count, seed)
    scales = half_whitening(snapshots @ modes.T)
    responses = respond(on_grid(modes, points, linear[: len(modes)]))
    return at_points(responses, points) * (force_scale * scales[:, None])


def leading_modes(snapshots: Tensor, count: int, seed: int) -> Tensor:
    """Return leading orthonormal modes of some snapshots, (count, n), not centred.

    Parameters
    ----------
    snapshots : Tensor, (N, n)
    count : int
        Number of modes, at most N and n.
    seed : int
        Seed of the randomised decomposition of a large matrix.
    """
    if min(snapshots.shape) <= 4 * count:
        return torch.linalg.svd(snapshots, full_matrices=False).Vh[:count].contiguous()
    from sklearn.utils.extmath import randomized_svd

    _, _, modes = randomized_svd(
        snapshots.numpy(),
        count,
        n_oversamples=SPARE_MODES,
        n_iter=POWER_ITERATIONS,
        random_state=seed % 2**32,
    )
    return torch.from_numpy(modes)


def half_whitening(values: Tensor) -> Tensor:
    """Factors that divide every column by the square root of its root mean square: (N, n) → (n,).

    The scaled values have a root mean square of 1 over all columns. Large and small columns differ
    by the square root of what they did: less than before, but the small ones, which samples tell
    less about, do not become as large as the others.
    """
    mean_square = values.square().mean(dim=0)
    factors = mean_square.clamp(min=torch.finfo(values.dtype).tiny).pow(-0.25)
    factors = torch.where(mean_square > 0, factors, torch.zeros_like(factors))
    overall = (values * factors).square().mean().sqrt()
    return torch.where(overall > 0, factors / overall, torch.ones_like(factors))
