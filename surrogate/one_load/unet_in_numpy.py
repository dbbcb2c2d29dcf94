r"""A trained U-Net as gathers and matrix products in NumPy, for one load at a time.

On small grids PyTorch spends most of a U-Net's time between its sums. Here a convolution gathers
the rows of all neighbours and multiplies them by one matrix:

.. math:: y_p = φ\Big( \sum_t W_t \, x_{n(p, t)} + b \Big)

with the taps t of the kernel and the neighbour n(p, t) of point p; a neighbour outside the grid is
a row of zeros. The sums are those of the convolutions, with fewer terms:

* Taps that are outside the grid at every point are left out.
* Batch normalisation is part of W and b.
* The decoder's first convolution reads a refined field, where two of the three taps along an axis
  fall on the same coarse point. Their weights are added: :math:`(W_0, W_1 + W_2)` at even points
  and :math:`(W_0 + W_1, W_2)` at odd ones, so that 2^d of 3^d products remain.

The points of a level are in blocks by parity, each in the order of the next coarser level. So max
pooling is the largest of 2^d blocks.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from surrogate.networks.unet import TRANSFORMS, UNet
from surrogate.one_load.dense_in_numpy import ACTIVATIONS, Activation, Array, Single, array

GATHERED = 2**17  # values gathered at once: 0.5 MB, a part of a core's cache
MERGED = {  # sums of the taps 0, 1, 2 along an axis, at even (0) and odd (1) points
    0: np.array([[1.0, 0, 0], [0, 1, 1]]),
    1: np.array([[1.0, 1, 0], [0, 0, 1]]),
}
Numbers = NDArray[np.int64]


class Product(NamedTuple):
    """Gathered rows times a matrix.

    Attributes
    ----------
    parts : tuple of (array of int, (n_some · n_taps,), slice)
        Numbers of the neighbours of some points, and the place of these points in the output.
    matrix : array, (n_taps · inputs, outputs)
    """

    parts: tuple[tuple[Numbers, slice], ...]
    matrix: Single

    def of(self, x: Single, out: Single) -> None:
        """Write the products with the rows of x, (n_rows, inputs), to (n_points, outputs)."""
        for rows, points in self.parts:
            gathered = x.take(rows, axis=0).reshape(-1, len(self.matrix))
            np.matmul(gathered, self.matrix, out=out[points])


class Convolution(NamedTuple):
    """A convolution with its activation, of a field and of the next coarser level's, refined.

    Attributes
    ----------
    points : int
        Number of points of the output.
    fine : Product
        Part of the field.
    coarse : tuple of Product
        Parts of the coarser field, one for each block of points; empty if there is none.
    bias : array, (outputs,)
    activation : callable
    """

    points: int
    fine: Product
    coarse: tuple[Product, ...]
    bias: Single
    activation: Activation

    def of(self, x: Single, refined: Single | None = None) -> Single:
        """Convolve: (n + 1, inputs) → (n_points + 1, outputs); the last rows are zero."""
        y = np.empty((self.points + 1, len(self.bias)), np.float32)
        y[-1] = 0
        inner = y[:-1]
        self.fine.of(x, inner)
        if refined is not None:
            blocks = inner.reshape(len(self.coarse), -1, len(self.bias))
            part = np.empty(blocks.shape[1:], np.float32)
            for block, weights in zip(blocks, self.coarse, strict=True):
                weights.of(refined, part)
                block += part
        inner += self.bias
        self.activation(inner)
        return y


class UNetInNumPy:
    """A U-Net in evaluation, from the input grid to the output grid of one load.

    Parameters
    ----------
    unet : UNet
        Network without random weights or masks; its weights are copied.
    shape : tuple of int
        Number of grid points along every axis.
    outputs : int
        Number of output channels to compute, the first ones.
    """

    def __init__(self, unet: UNet, shape: tuple[int, ...], outputs: int) -> None:
        d, count = unet.dimension, len(unet.encoder)
        pads = np.reshape(unet.pads(torch.Size(shape)), (d, 2))[::-1]  # before and after each axis
        padded = tuple(np.array(shape) + pads.sum(axis=1))
        levels = level_points(padded, count)
        numbers = [numbered(points) for points in levels]
        places = tuple(slice(1 + pads[0, 0], 1 + pads[0, 0] + n) for n in shape)
        outside = int(np.prod(shape))
        on_grid = np.full(numbers[0].shape, outside)  # as numbers[0], in the order of the grid
        on_grid[places] = np.arange(outside).reshape(shape)

        self.blocks = 2**d
        self.transformed = None if unet.transform is TRANSFORMS["linear"] else unet.transformed
        self.encoder: list[tuple[Convolution, ...]] = []
        self.decoder: list[tuple[Convolution, ...]] = []

        def convolution(level: int, source: Numbers, layer: Layer) -> Convolution:
            fine = product_of(layer.kernel, levels[level], source)
            return Convolution(len(levels[level]), fine, (), layer.bias, layer.activation)

        for level, layers in enumerate(unet.encoder):
            first, second = convolutions(layers)
            source = numbers[level] if level else on_grid
            self.encoder.append(
                (convolution(level, source, first), convolution(level, numbers[level], second))
            )
        for level, layers in zip(reversed(range(count - 1)), unet.decoder, strict=True):
            first, second = convolutions(layers)
            refined = len(self.encoder[level + 1][-1].bias)  # its first inputs are the refined ones
            fine = first._replace(kernel=first.kernel[:, refined:])
            coarse = (
                product_of(
                    merged(first.kernel[:, :refined], parity),
                    levels[level + 1],
                    numbers[level + 1],
                    np.array(parity) - 1,
                )
                for parity in product((0, 1), repeat=d)
            )
            joined = convolution(level, numbers[level], fine)._replace(coarse=tuple(coarse))
            self.decoder.append((joined, convolution(level, numbers[level], second)))
        head = array(unet.head.weight)[:outputs].reshape(outputs, -1)
        self.head: Single = np.ascontiguousarray(head.T, np.float32)
        self.head_bias: Single = array(unet.head.bias)[:outputs].astype(np.float32)
        self.rows = numbers[0][places].ravel()

    def __call__(self, fields: Single) -> Single:
        """Predict from the fields of one load, in scaled units.

        Parameters
        ----------
        fields : array, (n_points, inputs)
            Input at the grid points, in the order of a flattened (nx, ny[, nz]).

        Returns
        -------
        array, (n_points, outputs)
        """
        if self.transformed is not None:
            fields = self.transformed(torch.from_numpy(fields)).numpy()
        x: Single = np.concatenate((fields, np.zeros((1, fields.shape[1]), np.float32)))
        skipped = []
        with np.errstate(over="ignore"):  # exp(-x) of SiLU may be infinite
            for first, second in self.encoder[:-1]:
                skipped.append(second.of(first.of(x)))
                x = self._pooled(skipped[-1])
            first, second = self.encoder[-1]
            x = second.of(first.of(x))
            for first, second in self.decoder:
                x = second.of(first.of(skipped.pop(), refined=x))
        y: Single = x.take(self.rows, axis=0) @ self.head
        y += self.head_bias
        return y

    def _pooled(self, x: Single) -> Single:
        """Take the largest of the 2^d points of every coarser point, with a row of zeros."""
        blocks = x[:-1].reshape(self.blocks, -1, x.shape[1])
        y = np.empty((blocks.shape[1] + 1, x.shape[1]), np.float32)
        np.maximum.reduce(blocks, axis=0, out=y[:-1])
        y[-1] = 0
        return y


# --- tables of neighbours -------------------------------------------------------------------------


def level_points(shape: tuple[int, ...], count: int) -> list[Numbers]:
    """Places of the points of every level, finest first, each (n_points, d)."""
    points = np.argwhere(np.ones([n // 2 ** (count - 1) for n in shape], dtype=bool))
    levels = [points]
    for _ in range(count - 1):
        parities = product((0, 1), repeat=len(shape))
        levels.append(np.concatenate([2 * levels[-1] + np.array(parity) for parity in parities]))
    return levels[::-1]


def numbered(points: Numbers) -> Numbers:
    """Numbers of a level's points by place + 1; n_points in the rows around the grid."""
    numbers = np.full(points.max(axis=0) + 3, len(points))
    numbers[tuple((points + 1).T)] = np.arange(len(points))
    return numbers


def product_of(
    kernel: Array, points: Numbers, numbers: Numbers, first: NDArray[np.int64] | int = -1
) -> Product:
    """Make the product of a kernel, without the taps that are outside the grid everywhere.

    Parameters
    ----------
    kernel : array, (outputs, inputs, taps along x, y[, z])
    points : array of int, (n_points, d)
        Places of the output.
    numbers : array of int
        Numbers of the input, by place + 1; the largest stands for places outside.
    first : int or array of int, (d,)
        Offset of the first tap along every axis.
    """
    offsets = np.argwhere(np.ones(kernel.shape[2:], dtype=bool)) + first
    rows = numbers[tuple(np.moveaxis(points[:, None] + offsets + 1, -1, 0))]
    inside = (rows < numbers.max()).any(axis=0)
    taps = kernel.reshape(*kernel.shape[:2], -1)[:, :, inside]
    matrix = np.ascontiguousarray(taps.transpose(2, 1, 0).reshape(-1, len(kernel)), np.float32)
    rows, step = rows[:, inside], max(1, GATHERED // len(matrix))
    places = (slice(start, start + step) for start in range(0, len(rows), step))
    return Product(tuple((rows[place].ravel(), place) for place in places), matrix)


# --- weights ----------------------------------------------------------------------------------


class Layer(NamedTuple):
    """Kernel (outputs, inputs, 3, 3[, 3]), bias and activation of a convolution."""

    kernel: Array
    bias: Single
    activation: Activation


def convolutions(layers: nn.Module) -> Iterator[Layer]:
    """Convolutions of a level of the U-Net; batch norm is part of their kernels and biases."""
    kernel, bias = np.empty(0), np.empty(0)
    for module in layers.children():
        if isinstance(module, nn.Conv2d | nn.Conv3d):
            kernel, bias = array(module.weight), array(module.bias)
        elif isinstance(module, nn.BatchNorm2d | nn.BatchNorm3d):
            factor = array(module.weight) / np.sqrt(array(module.running_var) + module.eps)
            kernel = kernel * factor.reshape(-1, *[1] * (kernel.ndim - 1))
            bias = (bias - array(module.running_mean)) * factor + array(module.bias)
        else:
            yield Layer(kernel, bias.astype(np.float32), ACTIVATIONS[type(module)])


def merged(kernel: Array, parity: tuple[int, ...]) -> Array:
    """Kernel on the coarse points, for points of one parity: three taps an axis become two."""
    for axis, odd in enumerate(parity, start=2):
        kernel = np.moveaxis(np.tensordot(MERGED[odd], kernel, (1, axis)), 0, axis)
    return kernel
