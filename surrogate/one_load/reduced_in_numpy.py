"""Dense layers and reduced networks in NumPy, for one load or some."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf
from torch import Tensor, nn

from surrogate.networks.free_points import on_grid
from surrogate.networks.reduced_network import DenseNetwork, ReducedNetwork
from surrogate.probabilistic.ensemble import Ensemble

Single = NDArray[np.float32]
Array = NDArray[np.float64]
Activation = Callable[[Single], None]  # it changes an array in place


class DenseInNumPy:
    """Dense layers in evaluation, with activations between them: (…, inputs) → (…, outputs).

    Parameters
    ----------
    network : DenseNetwork
        Network without random weights; its weights are copied.
    outputs : int
        Number of outputs to compute, the first ones.
    """

    def __init__(self, network: DenseNetwork, outputs: int) -> None:
        self.activation = ACTIVATIONS[type(network.activation)]
        self.layers: list[tuple[Single, Single]] = []
        for layer in (network.first, *network.hidden, network.head):
            assert isinstance(layer, nn.Linear)
            matrix: Single = np.ascontiguousarray(array(layer.weight).T, np.float32)
            bias: Single = array(layer.bias).astype(np.float32)
            self.layers.append((matrix, bias))
        self.layers[-1] = np.ascontiguousarray(matrix[:, :outputs]), bias[:outputs]

    def __call__(self, x: Single) -> Single:
        """Evaluate."""
        matrix, bias = self.layers[0]
        with np.errstate(over="ignore"):  # exp(-x) of SiLU may be infinite
            y: Single = x @ matrix + bias
            for matrix, bias in self.layers[1:]:
                self.activation(y)
                y = y @ matrix + bias
        return y


class ReducedInNumPy:
    """A reduced network in evaluation, from the force grid to the mean correction of one load.

    Parameters
    ----------
    network : ReducedNetwork
        Network without random weights; its weights are copied.
    shape : tuple of int
        Number of grid points along every axis.
    """

    def __init__(self, network: ReducedNetwork, shape: tuple[int, ...]) -> None:
        dense = network.dense.members if isinstance(network.dense, Ensemble) else [network.dense]
        self.members = []
        for member in dense:
            assert isinstance(member, DenseNetwork)
            self.members.append(DenseInNumPy(member, len(network.modes)))
        self.orders: list[tuple[NDArray[np.int64], Single, Single]] = []
        if network.series is not None:
            scales = network.series.input_scales.numpy()
            for order, matrix, scale in zip(
                network.series.orders, network.series.coefficients, scales, strict=True
            ):
                factors = network.series.get_buffer(f"factors_{order}").numpy()
                self.orders.append((factors, matrix.numpy(), scale))

        def by_point(modes: Tensor) -> Single:
            """Columns of all points of the grid, in their order, then by component."""
            placed = on_grid(modes, network.points, modes.new_empty(1, len(shape), *shape))
            return np.ascontiguousarray(placed.flatten(2).swapaxes(1, 2).flatten(1).numpy())

        self.equilibrium = network.equilibrium
        self.encoder = np.ascontiguousarray(by_point(network.encoder).T)
        self.modes = by_point(network.modes) / np.float32(len(self.members))

    def __call__(self, fields: Single) -> Single:
        """Predict scaled corrections from scaled forces, both (N, n_points, d) or (n_points, d)."""
        return (self.amplitudes(fields) @ self.modes).reshape(fields.shape)

    def amplitudes(self, fields: Single) -> Single:
        """Coefficients of `modes` in the corrections: fields as above → (N, outputs)."""
        force = fields.reshape(-1, len(self.encoder))
        loaded = np.flatnonzero(force.any(axis=0))
        encoder, modes = self.encoder, self.modes
        if 4 * len(loaded) < len(encoder):
            force, encoder, modes = force[:, loaded], encoder[loaded], modes[:, loaded]
        total = self.coefficients(force @ encoder)
        if self.equilibrium is not None:
            total = self.equilibrium.of_arrays(force @ modes.T, total)
        return total

    def coefficients(self, coefficients: Single) -> Single:
        """Coefficients of the corrections, summed over members: (…, inputs) → (…, outputs)."""
        inputs, terms = [coefficients], []
        for factors, matrix, scale in self.orders:
            terms.append(coefficients[..., factors].prod(axis=-2) @ matrix)
            inputs.append(terms[-1] * scale)
        x = np.concatenate(inputs, axis=-1) if terms else coefficients
        total = self.members[0](x)
        for member in self.members[1:]:
            total += member(x)
        for term in terms:
            total += term * np.float32(len(self.members))
        return total


def array(parameter: Tensor | None) -> Array:
    """Weights in double precision, for sums of them."""
    assert parameter is not None
    return parameter.detach().double().cpu().numpy()


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
