"""Layers between convolutions and dense ones: activations by name, and normalisations.

Batch normalisation (Ioffe and Szegedy 2015) takes the mean off the values of a batch and divides by
their standard deviation; running means of both serve predictions. Over `channels`, every channel
has its own mean, over the batch and the grid. Over the `last_axis`, every row of the grid along it
has its own, over the batch, the channels and the other axes: so Keras normalises arrays whose
channels come first if its axis is left at its default. Group normalisation (Wu and He 2018) takes
the mean of a group of channels of one sample; with one group it is layer normalisation.
"""

from __future__ import annotations

from typing import Literal

from torch import Tensor, nn

Activation = Literal["relu", "gelu", "silu"]
ACTIVATIONS: dict[Activation, type[nn.Module]] = {"relu": nn.ReLU, "gelu": nn.GELU, "silu": nn.SiLU}
BatchNorm = bool | Literal["channels", "last_axis"]
OVER_CHANNELS = {2: nn.BatchNorm2d, 3: nn.BatchNorm3d}


class LastAxisNorm(nn.Module):
    """Batch normalisation of every row of the grid along its last axis.

    Parameters
    ----------
    dimension : int
    length : int
        Of the grid along its last axis.
    momentum, epsilon : float
        Of `torch.nn.BatchNorm2d`.
    """

    def __init__(self, dimension: int, length: int, momentum: float, epsilon: float) -> None:
        super().__init__()
        self.norm = OVER_CHANNELS[dimension](length, epsilon, momentum)

    def forward(self, fields: Tensor) -> Tensor:
        """Normalise fields (N, channels, nx, ny[, nz])."""
        normalised: Tensor = self.norm(fields.movedim(-1, 1))
        return normalised.movedim(1, -1)
