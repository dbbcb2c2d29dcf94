r"""Series of a body's displacement in its load, to third order.

.. math::
    u(t f) = t u_1 + t^2 u_2 + t^3 u_3 + O(t^4), \qquad K u_1 = f, \qquad
    K u_2 = -\tfrac{1}{2} f''_{int}[u_1, u_1], \qquad
    K u_3 = -f''_{int}[u_1, u_2] - \tfrac{1}{6} f'''_{int}[u_1, u_1, u_1]

K, f'' and f''' are the derivatives of the internal forces of the undeformed body. With a small h,
the part of :math:`f_{int}(h u_1)` that is even in u₁ is :math:`\tfrac{1}{2} h^2 f''[u_1, u_1] +
O(h^4)`, and the odd part of :math:`f_{int}(h u_1 + h^2 u_2)` is :math:`h f + h^3 (f''[u_1, u_2] +
\tfrac{1}{6} f'''[u_1, u_1, u_1]) + O(h^5)`. So each order takes two evaluations of the forces and
one solve with K.

This is Koiter's expansion about the unloaded state (W. T. Koiter, *On the stability of elastic
equilibrium*, 1945). It holds as long as loads are moderate: its remainder is of fourth order. It is
for bodies of any material; that of a Neo-Hookean one, to any order, is
`surrogate.series.series_response`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shared_schema.common.progress import Progress
from surrogate.mechanics.compliance import Compliance
from surrogate.mechanics.linear_response import LinearResponse
from surrogate.mechanics.out_of_balance import Equilibrium

if TYPE_CHECKING:
    from surrogate.data.dataset import Dataset

Array = NDArray[np.float64]
SMALL_SLOPE = 1e-3  # largest gradient of h u₁
AT_ONCE = 2**21  # values of the displacement gradients that are held at once: 16 MB


@dataclass(frozen=True)
class ThirdOrderTerms:
    """Terms of the displacements of N load cases, (N, n_nodes, d) in m.

    Attributes
    ----------
    first, second, third : array
        u₁, the linear response, u₂ and u₃.
    """

    first: Array
    second: Array
    third: Array


def third_order_terms(equilibrium: Equilibrium, forces: Array) -> ThirdOrderTerms:
    """Compute the terms of some loads.

    Parameters
    ----------
    equilibrium : Equilibrium
    forces : array, (N, n_nodes, d)
        In N.
    """
    first = equilibrium.linear_response(forces)
    slope = _largest_slope(equilibrium, first)[:, None, None]
    h = SMALL_SLOPE / np.where(slope > 0, slope, SMALL_SLOPE)

    def internal(u: Array) -> Array:
        return equilibrium.out_of_balance(u, np.zeros_like(u))

    even = (internal(h * first) + internal(-h * first)) / (2 * h**2)
    second = -equilibrium.linear_response(even)
    odd = internal(h * first + h**2 * second) - internal(-h * first + h**2 * second)
    loaded = forces * equilibrium.free
    third = -equilibrium.linear_response((odd / (2 * h) - loaded) / h**2)
    return ThirdOrderTerms(first, second, third)


def _largest_slope(equilibrium: Equilibrium, u: Array) -> Array:
    """Largest component of every displacement gradient: (N, n_nodes, d) → (N,)."""
    f = equilibrium.solid.deformation_gradient(torch.from_numpy(u))
    slope = f - torch.eye(len(f), dtype=f.dtype)[:, :, None, None, None]
    return slope.abs().amax((0, 1, 2, 4)).numpy()


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
    grid = dataset.geometry.grid
    batch = max(1, AT_ONCE // (equilibrium.solid.gradients[..., 0, :].numel() * force.shape[1]))
    progress = Progress(len(force), 0, "loads", "surrogate train: load series")
    second, third = [], []
    for start in range(0, len(force), batch):
        forces = linear.to_nodes(force[start : start + batch].flatten(2)).transpose(1, 2)
        terms = third_order_terms(equilibrium, forces.double().contiguous().numpy())
        second.append(torch.from_numpy(grid.to_grid(terms.second)).float())
        third.append(torch.from_numpy(grid.to_grid(terms.third)).float())
        progress.update(min(start + batch, len(force)))
    progress.close("done")
    return [torch.cat(second), torch.cat(third)]
