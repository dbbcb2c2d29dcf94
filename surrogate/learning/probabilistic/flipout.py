r"""Layers with a Gaussian posterior over their kernel, trained by Flipout (Wen et al. 2018).

.. math:: y_n = x_n * μ + \big((x_n ∘ s_n) * (σ ∘ ε)\big) ∘ r_n + b

One perturbation σ∘ε is shared by a batch; signs :math:`s_n` of the input channels and :math:`r_n`
of the output channels, drawn for every sample n, make the samples' perturbations uncorrelated, each
distributed as an independent one. The product * is a convolution, or that of a dense layer.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from typing import Literal

import torch
from pydantic import Field
from torch import Tensor, nn
from torch.nn import functional

from shared_schema.common.configuration import Frozen
from surrogate.learning.probabilistic.gaussian_parameter import GaussianParameter
from surrogate.learning.probabilistic.stochastic_passes import Sample, drawn_for
from surrogate.runtime.device import products_as_convolutions

CONVOLVE: dict[int, Callable[..., Tensor]] = {2: functional.conv2d, 3: functional.conv3d}


class VariationalConfig(Frozen):
    """Priors of the probabilistic weights, and the factor on the KL divergence.

    Attributes
    ----------
    biases : bool
        True if the biases of probabilistic layers are probabilistic too.
    prior_std : float
        Prior standard deviation σ_p.
    prior_mean : {"trainable", "zero"}
        Prior mean μ_p: trained (empirical Bayes) or fixed at zero.
    initial_std : float
        Initial standard deviation σ.
    posterior_std : {"gradient", "gauss_newton"}
        Method for σ: gradients of the bound, as in the paper, or the Fisher information
        (`gauss_newton`), which reaches the bound's maximum where gradients are lost in noise.
    kl_divergence : {"closed", "sampled"}
        Closed form of the Kullback–Leibler divergence, or the paper's Monte Carlo form.
    weight : float
        Factor on the KL divergence; 1 is the evidence lower bound, below 1 a tempered posterior.
    warmup : float
        Fraction of all steps over which that factor grows linearly from zero.
    """

    biases: bool = False
    prior_std: float = Field(0.1, ge=1e-9, le=1000)
    prior_mean: Literal["trainable", "zero"] = "trainable"
    initial_std: float = Field(0.01, ge=1e-9, le=1000)
    posterior_std: Literal["gradient", "gauss_newton"] = "gradient"
    kl_divergence: Literal["closed", "sampled"] = "closed"
    weight: float = Field(1.0, ge=1e-9, le=1000)
    warmup: float = Field(0.0, ge=0, le=1)

    def factor(self, step: int, steps: int) -> float:
        """Factor on the KL divergence at a step (0 … steps − 1)."""
        return self.weight * min(1.0, (step + 1) / (self.warmup * steps) if self.warmup else 1.0)


class VariationalConvolutions(VariationalConfig):
    """Selection of the probabilistic convolutions of a U-Net, and their priors.

    Attributes
    ----------
    convolutions : tuple of {1, 2}
        Numbers of the probabilistic convolutions among the two of a level.
    levels : tuple of int, optional
        Levels with probabilistic convolutions, 0 being the finest; all levels if left out.
    """

    convolutions: tuple[Literal[1, 2], ...] = Field((2,), min_length=1, max_length=2)
    levels: tuple[int, ...] | None = Field(None, min_length=1, max_length=10)

    def covers(self, level: int, number: int) -> bool:
        """Tell whether convolution `number` (1 or 2) of a level is probabilistic."""
        return number in self.convolutions and (self.levels is None or level in self.levels)


class FlipoutLayer(nn.Module, ABC):
    """A layer with a probabilistic kernel.

    In training every sample of a batch has another kernel. In evaluation the mean kernel is used.
    With what is drawn (`drawn.using`), a batch consists of as many equal chunks as there were
    draws, each with one drawn kernel.

    Parameters
    ----------
    weight, bias : Tensor
        Initial means, outputs first.
    config : VariationalConfig
    """

    fixed: Sample | None = None

    def __init__(self, weight: Tensor, bias: Tensor, config: VariationalConfig) -> None:
        super().__init__()
        self.sampled = config.kl_divergence == "sampled"

        def gaussian(mean: Tensor) -> GaussianParameter:
            trainable = config.prior_mean == "trainable"
            return GaussianParameter(mean, config.initial_std, config.prior_std, trainable)

        self.kernel = gaussian(weight)
        self.bias = gaussian(bias) if config.biases else nn.Parameter(bias.detach().clone())
        self._noise: list[Tensor] = []

    @abstractmethod
    def apply_kernel(self, x: Tensor, kernel: Tensor, bias: Tensor | None = None) -> Tensor:
        """Apply one kernel to a batch: (N, inputs, …) → (N, outputs, …)."""

    @abstractmethod
    def apply_kernels(self, x: Tensor, kernels: Tensor, biases: Tensor) -> Tensor:
        """Apply a kernel of its own to each of the equal chunks of a batch."""

    def forward(self, x: Tensor) -> Tensor:
        """Apply the layer: (N, inputs, …) → (N, outputs, …)."""
        drawn = drawn_for(self)
        if drawn is not None:
            return self.apply_kernels(x, *drawn)
        bias = self.bias.mean if isinstance(self.bias, GaussianParameter) else self.bias
        y = self.apply_kernel(x, self.kernel.mean, bias)
        return y + self._perturbation(x) if self.training else y

    def _perturbation(self, x: Tensor) -> Tensor:
        """Contribution to the output of the weights' random deviations from their means."""
        kernel, extra = self.kernel, (1,) * (x.ndim - 2)
        noise = torch.randn_like(kernel.mean)
        self._noise = [noise]
        signs = random_signs(x, (len(x), kernel.mean.shape[1], *extra))
        flipped = random_signs(x, (len(x), kernel.mean.shape[0], *extra))
        y = self.apply_kernel(x * signs, kernel.std * noise) * flipped
        if isinstance(self.bias, GaussianParameter):
            noise = torch.randn(len(x), len(self.bias.mean), dtype=x.dtype, device=x.device)
            self._noise.append(noise[0])
            y = y + (self.bias.std * noise).reshape(*noise.shape, *extra)
        return y

    def kl_divergence(self) -> Tensor:
        """KL divergence of kernel and biases in nats; the sampled form uses the latest noise."""
        parameters = [p for p in (self.kernel, self.bias) if isinstance(p, GaussianParameter)]
        if not self.sampled:
            return torch.stack([p.kl_divergence() for p in parameters]).sum()
        pairs = zip(parameters, self._noise, strict=True)
        return torch.stack([p.sampled_kl_divergence(noise) for p, noise in pairs]).sum()

    def draw(self, generators: Sequence[torch.Generator]) -> tuple[Tensor, Tensor]:
        """Draw independent kernels and biases for evaluation, one of each for every generator."""
        if isinstance(self.bias, GaussianParameter):
            bias = self.bias.draw(generators)
        else:
            bias = self.bias.expand(len(generators), -1)
        return self.kernel.draw(generators), bias


class FlipoutConvolution(FlipoutLayer):
    """3×3(×3) convolution that keeps the grid's size, with a probabilistic kernel.

    Parameters
    ----------
    convolution : nn.Conv2d or nn.Conv3d
        Convolution with the initial means.
    config : VariationalConfig
    """

    def __init__(self, convolution: nn.Conv2d | nn.Conv3d, config: VariationalConfig) -> None:
        assert convolution.bias is not None
        super().__init__(convolution.weight, convolution.bias, config)
        self.convolve = CONVOLVE[convolution.weight.ndim - 2]

    def apply_kernel(self, x: Tensor, kernel: Tensor, bias: Tensor | None = None) -> Tensor:
        """Convolve: (N, inputs, nx, ny[, nz]) → (N, outputs, nx, ny[, nz])."""
        return self.convolve(x, kernel, bias, padding=1)

    def apply_kernels(self, x: Tensor, kernels: Tensor, biases: Tensor) -> Tensor:
        """Convolve each chunk of the batch with its own kernel, in one grouped convolution.

        On a GPU, which takes the groups one by one, it is one batched product.
        """
        if x.device.type == "cuda" and not torch.compiler.is_compiling():
            return convolved_by_products(x, kernels, biases)
        passes, (samples, inputs), grid = len(kernels), x.shape[:2], x.shape[2:]
        samples //= passes
        grouped = x.reshape(passes, samples, inputs, *grid).transpose(0, 1)
        y = self.convolve(
            grouped.reshape(samples, passes * inputs, *grid),
            kernels.flatten(0, 1),
            biases.flatten(),
            padding=1,
            groups=passes,
        )
        by_pass = y.reshape(samples, passes, kernels.shape[1], *grid).transpose(0, 1)
        return by_pass.reshape(passes * samples, kernels.shape[1], *grid)

    def draw(self, generators: Sequence[torch.Generator]) -> tuple[Tensor, Tensor]:
        """Draw kernels and biases; on a GPU in the layout of `convolved_by_products`."""
        kernels, biases = super().draw(generators)
        if kernels.device.type == "cuda":
            kernels = kernels.movedim((2, 1), (-2, -1)).contiguous().movedim((-2, -1), (2, 1))
        return kernels, biases


def convolved_by_products(x: Tensor, kernels: Tensor, biases: Tensor) -> Tensor:
    """Convolve equal chunks of a batch with a 3×3(×3) kernel each, as products with their windows.

    Parameters
    ----------
    x : Tensor, (K · N, inputs, nx, ny[, nz])
    kernels : Tensor, (K, outputs, inputs, 3, 3[, 3])
        Not copied if outputs follow each other in memory, and inputs are next to them.
    biases : Tensor, (K, outputs)

    Returns
    -------
    Tensor, (K · N, outputs, nx, ny[, nz])
    """
    (passes, outputs), grid = kernels.shape[:2], x.shape[2:]
    padded = functional.pad(x.movedim(1, -1), (0, 0, *(1, 1) * len(grid)))
    shifts = product(range(3), repeat=len(grid))
    windows = torch.cat(
        [
            padded[(slice(None), *(slice(i, i + n) for i, n in zip(shift, grid, strict=True)))]
            for shift in shifts
        ],
        dim=-1,
    )
    columns = windows.reshape(passes, -1, windows.shape[-1])
    matrices = kernels.movedim((2, 1), (-2, -1)).reshape(passes, -1, outputs)
    with products_as_convolutions():
        y = torch.baddbmm(biases[:, None], columns, matrices)
    return y.reshape(len(x), *grid, outputs).movedim(-1, 1)


class FlipoutDense(FlipoutLayer):
    """Dense layer with a probabilistic matrix.

    Parameters
    ----------
    dense : nn.Linear
        Layer with the initial means.
    config : VariationalConfig
    """

    def __init__(self, dense: nn.Linear, config: VariationalConfig) -> None:
        super().__init__(dense.weight, dense.bias, config)

    def apply_kernel(self, x: Tensor, kernel: Tensor, bias: Tensor | None = None) -> Tensor:
        """Multiply: (N, inputs) → (N, outputs)."""
        return functional.linear(x, kernel, bias)

    def apply_kernels(self, x: Tensor, kernels: Tensor, biases: Tensor) -> Tensor:
        """Multiply each chunk of the batch by its own matrix."""
        chunks = x.reshape(len(kernels), -1, x.shape[-1])
        return torch.baddbmm(biases[:, None], chunks, kernels.mT).flatten(0, 1)


def flipouts(network: nn.Module) -> Iterator[FlipoutLayer]:
    """Every Flipout layer of a network."""
    return (module for module in network.modules() if isinstance(module, FlipoutLayer))


def random_signs(like: Tensor, shape: tuple[int, ...]) -> Tensor:
    """Signs ±1, each with probability 1/2, of the type and device of a tensor."""
    signs = torch.randint(0, 2, shape, dtype=like.dtype, device=like.device)
    return 2 * signs - 1
