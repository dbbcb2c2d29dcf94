r"""What a network's output means, and the loss that follows from it.

Deterministic, by name:

====  ==========================================================================================
mse   :math:`\frac{1}{N} \sum_i \| U(f_i) - u_i \|_2^2` (Deshpande et al. 2022, Eq. lossDeterm)
mae   :math:`\frac{1}{N} \sum_i \| U(f_i) - u_i \|_1`, the measure ē itself
====  ==========================================================================================

Both are divided by the number of components, and the error by the displacement's root mean square,
so that losses of different cases compare; the minimiser is the same.
"""

from __future__ import annotations

from typing import Literal

from torch import Tensor

Likelihood = Literal["deterministic"]
Loss = Literal["mse", "mae"]


def output_channels(likelihood: Likelihood, dimension: int) -> int:
    """Number of output channels: one a displacement component."""
    return dimension


def deterministic_loss(loss: Loss, predicted: Tensor, reference: Tensor, unit: Tensor) -> Tensor:
    """Mean over samples and components of ((U − u) / unit)² or |U − u| / unit.

    Parameters
    ----------
    loss : {"mse", "mae"}
    predicted, reference : Tensor, (N, d, nx, ny[, nz])
        Displacements U and u in m.
    unit : Tensor, ()
        In m.
    """
    error = (predicted - reference) / unit
    return error.square().mean() if loss == "mse" else error.abs().mean()
