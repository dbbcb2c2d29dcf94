"""Terms of the load series on the grid, which a reduced network is fitted to."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from shared_schema.common.progress import Progress
from surrogate.mechanics.equilibrium.compliance import Compliance
from surrogate.mechanics.equilibrium.linear_response import LinearResponse
from surrogate.mechanics.series.body_series import BodySeries

if TYPE_CHECKING:
    from surrogate.learning.data.dataset import Dataset

ORDER = 3
AT_ONCE = 2**21  # values of the displacement gradients that are held at once: 16 MB


def series_on_grid(dataset: Dataset, linear: LinearResponse, force: Tensor) -> list[Tensor]:
    """Compute the terms of second and third order under some loads.

    They are those of the same elements and material as the linear response.

    Parameters
    ----------
    dataset : Dataset
    linear : LinearResponse
        Of the dataset's body.
    force : Tensor, (N, d, nx, ny[, nz])
        Forces on the grid in N.

    Returns
    -------
    list of two Tensors, (N, d, nx, ny[, nz])
        In m.
    """
    assert isinstance(linear.compliance, Compliance)
    equilibrium = linear.compliance.equilibrium  # with its factor of K
    series, grid = BodySeries(equilibrium, ORDER), dataset.geometry.grid
    batch = max(1, AT_ONCE // (equilibrium.solid.gradients[..., 0, :].numel() * force.shape[1]))
    progress = Progress(len(force), 0, "loads", "surrogate train: load series")
    second, third = [], []
    for start in range(0, len(force), batch):
        forces = linear.to_nodes(force[start : start + batch].flatten(2)).transpose(1, 2)
        terms, _ = series.terms(series.first(forces.double()))
        second.append(torch.from_numpy(grid.to_grid(terms[1].numpy())).float())
        third.append(torch.from_numpy(grid.to_grid(terms[2].numpy())).float())
        progress.update(min(start + batch, len(force)))
    progress.close("done")
    return [torch.cat(second), torch.cat(third)]
