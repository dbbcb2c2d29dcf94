"""The U-Net of Deshpande et al. (2022), Section 2.2, in two and three dimensions.

Zero padding of the grid; at every level two 3×3(×3) convolutions, each with batch normalisation
and an activation; 2×2(×2) max pooling on the way down; nearest up-sampling by 2 on the way up,
concatenated with what the way down had at that level; a 1×1 linear convolution at the end.
"""

from __future__ import annotations

from typing import Literal

import torch
from pydantic import Field
from torch import Tensor, nn
from torch.nn import functional

from shared_schema.configuration import Frozen

CONVOLUTIONS: dict[int, type[nn.Conv2d | nn.Conv3d]] = {2: nn.Conv2d, 3: nn.Conv3d}
BATCH_NORMS = {2: nn.BatchNorm2d, 3: nn.BatchNorm3d}
POOLINGS = {2: nn.MaxPool2d, 3: nn.MaxPool3d}
ACTIVATIONS: dict[str, type[nn.Module]] = {"relu": nn.ReLU, "gelu": nn.GELU, "silu": nn.SiLU}


class UNetConfig(Frozen):
    """Shape of a U-Net (defaults: the paper's in two dimensions).

    Attributes
    ----------
    levels : int
        Number of resolutions, the finest included.
    channels : int
        Channels c of the finest level.
    multiplier : int
        Factor from the channels of one level to those of the next coarser; 1 keeps them constant.
    padding : int
        Rows of zeros put around the grid on every side.
    activation : {"relu", "gelu", "silu"}
    batch_norm : bool
    """

    levels: int = Field(3, ge=1)
    channels: int = Field(128, ge=1)
    multiplier: int = Field(2, ge=1)
    padding: int = Field(2, ge=0)
    activation: Literal["relu", "gelu", "silu"] = "relu"
    batch_norm: bool = True

    def level_channels(self) -> list[int]:
        """Channels of every level, finest first."""
        return [self.channels * self.multiplier**level for level in range(self.levels)]


class DoubleConvolution(nn.Sequential):
    """Two 3×3(×3) convolutions that keep the grid's size, each with batch norm and activation."""

    def __init__(self, dimension: int, inputs: int, outputs: int, config: UNetConfig) -> None:
        layers: list[nn.Module] = []
        for channels in (inputs, outputs):
            layers.append(start_as_he(CONVOLUTIONS[dimension](channels, outputs, 3, padding=1)))
            if config.batch_norm:
                layers.append(BATCH_NORMS[dimension](outputs))
            layers.append(ACTIVATIONS[config.activation]())
        super().__init__(*layers)


class UNet(nn.Module):
    """Force grid in, displacement grid out: (N, d, nx, ny[, nz]) → (N, outputs, nx, ny[, nz]).

    Parameters
    ----------
    dimension : int
        d, 2 or 3; also the number of input channels.
    outputs : int
        Output channels.
    config : UNetConfig
    """

    def __init__(self, dimension: int, outputs: int, config: UNetConfig) -> None:
        super().__init__()
        self.dimension = dimension
        self.padding = config.padding
        self.coarsening = 2 ** (config.levels - 1)
        channels = config.level_channels()
        self.encoder = nn.ModuleList(
            DoubleConvolution(dimension, inputs, here, config)
            for inputs, here in zip([dimension, *channels[:-1]], channels, strict=True)
        )
        self.decoder = nn.ModuleList(
            DoubleConvolution(dimension, coarser + here, here, config)
            for coarser, here in zip(channels[:0:-1], channels[-2::-1], strict=True)
        )
        self.pool = POOLINGS[dimension](2)
        self.head = CONVOLUTIONS[dimension](channels[0], outputs, kernel_size=1)

    def forward(self, force: Tensor) -> Tensor:
        """Predict the displacement grid from the force grid, both in scaled units."""
        size = force.shape[2:]
        x = functional.pad(force, self._pads(size))
        skipped = []
        for level in self.encoder[:-1]:
            x = level(x)
            skipped.append(x)
            x = self.pool(x)
        x = self.encoder[-1](x)
        for level in self.decoder:
            x = functional.interpolate(x, scale_factor=2, mode="nearest")
            x = level(torch.cat((x, skipped.pop()), dim=1))
        x = self.head(x)
        for axis, length in enumerate(size, start=2):
            x = x.narrow(axis, self.padding, length)
        cropped: Tensor = x
        return cropped

    def _pads(self, size: torch.Size) -> list[int]:
        """Padding of each axis, last axis first, so that the levels divide the padded length."""
        pads: list[int] = []
        for length in reversed(size):
            padded = length + 2 * self.padding
            pads += [self.padding, self.padding + -padded % self.coarsening]
        return pads


def start_as_he(convolution: nn.Conv2d | nn.Conv3d) -> nn.Module:
    """Start a kernel as He et al. (2015) propose for rectifiers, and the bias at zero."""
    nn.init.kaiming_normal_(convolution.weight, nonlinearity="relu")
    assert convolution.bias is not None
    nn.init.zeros_(convolution.bias)
    return convolution


def parameter_count(module: nn.Module) -> int:
    """Number of trainable parameters."""
    return sum(p.numel() for p in module.parameters() if p.requires_grad)
