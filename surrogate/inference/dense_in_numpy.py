"""Dense layers and activations in NumPy, for one load at a time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf
from torch import Tensor, nn

Single = NDArray[np.float32]
Array = NDArray[np.float64]
Activation = Callable[[Single], None]  # it changes an array in place


class DenseInNumPy:
    """A multilayer perceptron in evaluation: (inputs,) or (N, inputs) → (outputs,) or (N, outputs).

    Parameters
    ----------
    layers : nn.Sequential
        Linear layers, each followed by an activation or not; their weights are copied.
    """

    def __init__(self, layers: nn.Sequential) -> None:
        self.layers: list[tuple[Single, Single | None, Activation | None]] = []
        for module in layers:
            if isinstance(module, nn.Linear):
                matrix = np.ascontiguousarray(array(module.weight).T, np.float32)
                bias = None if module.bias is None else array(module.bias).astype(np.float32)
                self.layers.append((matrix, bias, None))
            else:
                self.layers[-1] = (*self.layers[-1][:2], ACTIVATIONS[type(module)])

    def __call__(self, x: Single) -> Single:
        """Evaluate all layers."""
        with np.errstate(over="ignore"):  # exp(-x) of SiLU may be infinite
            for matrix, bias, activation in self.layers:
                x = x @ matrix
                if bias is not None:
                    x += bias
                if activation is not None:
                    activation(x)
        return x


def array(parameter: Tensor | None) -> Array:
    """Weights in double precision, for sums of them."""
    assert parameter is not None
    copied: Array = parameter.detach().double().cpu().numpy()
    return copied


def relu(x: Single) -> None:
    """Replace x by max(x, 0)."""
    np.maximum(x, 0, out=x)


def silu(x: Single) -> None:
    """Replace x by x / (1 + exp(−x))."""
    denominator = np.negative(x)
    np.exp(denominator, out=denominator)
    denominator += 1
    x /= denominator


def gelu(x: Single) -> None:
    """Replace x by x/2 (1 + erf(x / √2))."""
    half = x * np.float32(0.5)
    x *= np.float32(0.5**0.5)
    erf(x, out=x)
    x += 1
    x *= half


ACTIVATIONS: dict[type[nn.Module], Activation] = {
    nn.ReLU: relu,
    nn.SiLU: silu,
    nn.GELU: gelu,
}
