"""The U-Net of Deshpande et al. (2022), Section 2.2, in two and three dimensions.

The grid is padded with zeros. Every level has two 3×3(×3) convolutions, each with a normalisation
and an activation. The encoder coarsens by 2×2(×2) max pooling. The decoder refines by
nearest-neighbour up-sampling by 2 and concatenates the encoder's output of the same level. The last
layer is a 1×1(×1) convolution without activation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Literal, Self

import torch
from pydantic import Field, model_validator
from torch import Tensor, nn
from torch.nn import functional

from shared_schema.common.configuration import Frozen
from surrogate.learning.networks.field_network import Channels, Input, channels_of
from surrogate.learning.networks.layers import (
    ACTIVATIONS,
    OVER_CHANNELS,
    Activation,
    BatchNorm,
    LastAxisNorm,
)
from surrogate.learning.probabilistic.flipout import FlipoutConvolution, VariationalConvolutions
from surrogate.learning.probabilistic.stochastic_passes import ChannelDropout

CONVOLUTIONS: dict[int, type[nn.Conv2d | nn.Conv3d]] = {2: nn.Conv2d, 3: nn.Conv3d}
POOLINGS = {2: nn.MaxPool2d, 3: nn.MaxPool3d}
Transform = Literal["linear", "asinh", "saturating"]


def linear(force: Tensor) -> Tensor:
    """Return the forces."""
    return force


def saturating(force: Tensor) -> Tensor:
    """Return f / √(1 + f²/3) of scaled forces f; its limits ±√3 bound the training range."""
    return force * torch.rsqrt(1 + force.square() / 3)


TRANSFORMS: dict[Transform, Callable[[Tensor], Tensor]] = {
    "linear": linear,
    "asinh": torch.asinh,
    "saturating": saturating,
}

MOST_CHANNELS = 2**16  # of a level


class UNetConfig(Frozen):
    """Architecture of a U-Net (defaults: the paper's in two dimensions).

    Attributes
    ----------
    levels : int
        Number of levels (grid resolutions), including the finest.
    channels : int
        Number of channels c of the finest level.
    multiplier : int
        Ratio of the numbers of channels of a level and of the next finer one.
    padding : int
        Number of rows of zeros around the grid on every side.
    activation : {"relu", "gelu", "silu"}
        Function after every convolution but the last.
    batch_norm : bool, "channels" or "last_axis"
        Normalise every convolution's output over the batch: each channel (true is the same), or
        each row of the grid along its last axis, as Keras does with channels that come first.
    batch_norm_momentum : float
        Share of a batch in the running means that predictions use; Keras has 0.01.
    batch_norm_epsilon : float
        Added to variances; Keras has 1e-3.
    group_norm : int
        Number of groups of channels that are normalised in every sample, instead of `batch_norm`;
        1 is layer normalisation, 0 none.
    initialisation : {"he", "glorot"}
        Distribution of the first kernels: normal by He et al. (2015), or uniform by Glorot and
        Bengio (2010).
    inputs : tuple of {"force", "linear_gradient", "last_gradient"}
        Input channels of the first convolution: the d components of the force, as in the paper, the
        d² components of the displacement gradient of the linear response K⁻¹ f, and those of the
        last term of the load series, over their largest value.
    skip : {"none", "linear", "series"}
        With ``linear`` the network predicts the difference from the linear response, with
        ``series`` that from the series of the displacement in the load, in units of the gradient
        of its last term; on an embedded grid a share of the linear gradient is added.
    series_order : int
        Order of the last term of that series.
    force_transforms : tuple of {"linear", "asinh", "saturating"}
        Function of the scaled forces f that the first convolution is given: f, arsinh f or
        f / √(1 + f²/3). Within the training range, −√3 to √3, all are equally good. Beyond it the
        network extrapolates linearly in its input. The members of an ensemble take the functions in
        turn, so that the ensemble covers responses that stay linear, stiffen or saturate.
    dropout : float
        Probability that a channel is dropped after the second convolution of a level, in training
        and in stochastic passes.
    """

    levels: int = Field(3, ge=1, le=10)
    channels: int = Field(128, ge=1, le=4096)
    multiplier: int = Field(2, ge=1, le=8)
    padding: int = Field(2, ge=0, le=64)
    activation: Activation = "relu"
    batch_norm: BatchNorm = True
    batch_norm_momentum: float = Field(0.1, gt=0, le=1)
    batch_norm_epsilon: float = Field(1e-5, gt=0, le=1)
    group_norm: int = Field(0, ge=0, le=4096)
    initialisation: Literal["he", "glorot"] = "he"
    inputs: tuple[Input, ...] = Field(("force",), min_length=1)
    skip: Literal["none", "linear", "series"] = "none"
    series_order: int = Field(3, ge=2, le=20)
    force_transforms: tuple[Transform, ...] = Field(("linear",), min_length=1, max_length=100)
    dropout: float = Field(0.0, ge=0, lt=1)

    @model_validator(mode="after")
    def _each_input_once(self) -> Self:
        if len(set(self.inputs)) < len(self.inputs):
            raise ValueError(f"inputs = {list(self.inputs)}: expected each once")
        gradients = {"linear_gradient", "last_gradient"} & set(self.inputs)
        if self.skip == "series" and len(gradients) < 2:
            raise ValueError(
                f"inputs = {list(self.inputs)}: expected linear_gradient and last_gradient with "
                "skip 'series'"
            )
        if "last_gradient" in self.inputs and self.skip != "series":
            raise ValueError("inputs = last_gradient: expected with skip 'series'")
        if "force" not in self.inputs and self.force_transforms != ("linear",):
            raise ValueError(
                f"force_transforms = {list(self.force_transforms)}: expected with input 'force'"
            )
        return self

    @model_validator(mode="after")
    def _one_norm(self) -> Self:
        if self.group_norm and self.batch_norm:
            raise ValueError(
                f"group_norm = {self.group_norm}, batch_norm = {self.batch_norm}: expected one of "
                "them (batch_norm = false)"
            )
        if self.group_norm and self.channels % self.group_norm:
            raise ValueError(
                f"group_norm = {self.group_norm}: expected a divisor of channels = {self.channels}"
            )
        return self

    @model_validator(mode="after")
    def _channels_of_the_coarsest_level(self) -> Self:
        most = self.level_channels()[-1]
        if most > MOST_CHANNELS:
            raise ValueError(
                f"channels = {self.channels}, multiplier = {self.multiplier}, levels = "
                f"{self.levels}: {most} channels at the coarsest level, expected {MOST_CHANNELS} "
                "at most"
            )
        return self

    @property
    def needs_gradient(self) -> bool:
        """True if an input is a gradient of the response of the body."""
        return "linear_gradient" in self.inputs

    @property
    def needs_linear_response(self) -> bool:
        """True if an input or the output needs the linear response of the body."""
        return self.needs_gradient or self.skip != "none"

    def input_channels(self, dimension: int) -> int:
        """Return the number of input channels in d dimensions."""
        return channels_of(self.inputs, dimension)[self.inputs[-1]].stop

    def level_channels(self) -> list[int]:
        """Return the number of channels of every level, finest first."""
        return [self.channels * self.multiplier**level for level in range(self.levels)]

    def padded(self, length: int) -> int:
        """Return the number of points of an axis with zeros, which every level halves evenly."""
        whole, coarsest = length + 2 * self.padding, 2 ** (self.levels - 1)
        return whole + -whole % coarsest

    def norm(self, dimension: int, channels: int, length: int | None) -> nn.Module | None:
        """Build a normalisation of some channels.

        Parameters
        ----------
        dimension : int
        channels : int
        length : int, optional
            Of the level's grid along its last axis; needed with `batch_norm: last_axis`.
        """
        if self.group_norm:
            return nn.GroupNorm(self.group_norm, channels)
        constants = self.batch_norm_momentum, self.batch_norm_epsilon
        if self.batch_norm == "last_axis":
            assert length is not None
            return LastAxisNorm(dimension, length, *constants)
        if not self.batch_norm:
            return None
        momentum, epsilon = constants
        return OVER_CHANNELS[dimension](channels, epsilon, momentum)


class DoubleConvolution(nn.Sequential):
    """Two 3×3(×3) convolutions that keep the grid's size, each with norm and activation.

    `probabilistic` returns the configuration of the random weights of convolution 1 or 2; None if
    its weights are deterministic.
    """

    def __init__(
        self,
        dimension: int,
        inputs: int,
        outputs: int,
        config: UNetConfig,
        probabilistic: Callable[[int], VariationalConvolutions | None],
        length: int | None,
    ) -> None:
        layers: list[nn.Module] = []
        for number, channels in enumerate((inputs, outputs), start=1):
            kernel = CONVOLUTIONS[dimension](channels, outputs, 3, padding=1)
            INITIALISATIONS[config.initialisation](kernel)
            variational = probabilistic(number)
            layers.append(FlipoutConvolution(kernel, variational) if variational else kernel)
            norm = config.norm(dimension, outputs, length)
            layers += [] if norm is None else [norm]
            layers.append(ACTIVATIONS[config.activation]())
        if config.dropout:
            layers.append(ChannelDropout(outputs, config.dropout))
        super().__init__(*layers)


class UNet(nn.Module):
    """U-Net from input grid (N, inputs, nx, ny[, nz]) to displacement grid (N, outputs, …).

    Parameters
    ----------
    dimension : int
        Number of space dimensions d, 2 or 3.
    outputs : int
        Number of output channels.
    config : UNetConfig
    variational : VariationalConvolutions, optional
        Choice of the convolutions with random weights; without it all weights are deterministic.
    member : int
        Number of the network in an ensemble, from 0.
    last_axis : int, optional
        Number of points of the grid along its last axis; needed with `batch_norm: last_axis`.
    parameters : int
        Number of further input channels, which hold the parameters of a shape.
    """

    def __init__(
        self,
        dimension: int,
        outputs: int,
        config: UNetConfig,
        variational: VariationalConvolutions | None = None,
        member: int = 0,
        last_axis: int | None = None,
        parameters: int = 0,
    ) -> None:
        super().__init__()
        self.dimension, self.config = dimension, config
        of_shape: tuple[Channels, ...] = ("shape",) if parameters else ()
        self.inputs = channels_of((*config.inputs, *of_shape), dimension, parameters)
        transforms = config.force_transforms
        self.transform = TRANSFORMS[transforms[member % len(transforms)]]
        channels = config.level_channels()
        whole = None if last_axis is None else config.padded(last_axis)

        def double(level: int, inputs: int) -> DoubleConvolution:
            def probabilistic(number: int) -> VariationalConvolutions | None:
                return variational if variational and variational.covers(level, number) else None

            length = None if whole is None else whole // 2**level
            return DoubleConvolution(
                dimension, inputs, channels[level], config, probabilistic, length
            )

        self.encoder = nn.ModuleList(
            double(level, inputs)
            for level, inputs in enumerate(
                [config.input_channels(dimension) + parameters, *channels[:-1]]
            )
        )
        self.decoder = nn.ModuleList(
            double(level, channels[level + 1] + channels[level])
            for level in reversed(range(config.levels - 1))
        )
        self.pool = POOLINGS[dimension](2)
        self.head = CONVOLUTIONS[dimension](channels[0], outputs, kernel_size=1)
        if config.initialisation == "glorot":
            start_as_glorot(self.head)

    def forward(self, fields: Tensor) -> Tensor:
        """Predict the displacement grid from the input grid, both in scaled units.

        The channels of the inputs are in the order of `UNetConfig.inputs`.
        """
        size = fields.shape[2:]
        x = functional.pad(self.transformed(fields), self.pads(size))
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
            x = x.narrow(axis, self.config.padding, length)
        return x

    def transformed(self, fields: Tensor) -> Tensor:
        """Transform the channels of the forces, and no others."""
        if "force" not in self.inputs:
            return fields
        parts = {name: fields[:, channels] for name, channels in self.inputs.items()}
        parts["force"] = self.transform(parts["force"])
        return torch.cat(list(parts.values()), dim=1) if len(parts) > 1 else parts["force"]

    def pads(self, size: torch.Size) -> list[int]:
        """Return the padding of each axis, last axis first.

        Every level halves the padded lengths without a remainder.
        """
        pads: list[int] = []
        before = self.config.padding
        for length in reversed(size):
            pads += [before, self.config.padded(length) - length - before]
        return pads


def start_as_he(convolution: nn.Conv2d | nn.Conv3d) -> None:
    """Initialise a kernel by He et al. (2015) for ReLU, and its bias with zero."""
    nn.init.kaiming_normal_(convolution.weight, nonlinearity="relu")
    start_bias(convolution)


def start_as_glorot(convolution: nn.Conv2d | nn.Conv3d) -> None:
    """Initialise a kernel by Glorot and Bengio (2010), uniformly, and its bias with zero."""
    nn.init.xavier_uniform_(convolution.weight)
    start_bias(convolution)


def start_bias(convolution: nn.Conv2d | nn.Conv3d) -> None:
    """Initialise the bias with zero."""
    assert convolution.bias is not None
    nn.init.zeros_(convolution.bias)


INITIALISATIONS = {"he": start_as_he, "glorot": start_as_glorot}


def normalised_biases(network: nn.Module) -> Iterator[nn.Parameter]:
    """Biases that a normalisation of channels takes away again: their gradients are zero."""
    for block in network.modules():
        if isinstance(block, DoubleConvolution):
            for layer, following in pairwise(block):
                is_normalised = isinstance(following, nn.BatchNorm2d | nn.BatchNorm3d)
                if is_normalised and isinstance(layer.bias, nn.Parameter):
                    yield layer.bias
