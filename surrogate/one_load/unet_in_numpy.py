r"""A trained U-Net as gathers and matrix products in NumPy, for one load or some.

PyTorch prepares every convolution for a single small grid anew, and copies it. Here a convolution
gathers the rows of all neighbours and multiplies them by one matrix:

.. math:: y_p = φ\Big( \sum_t W_t \, x_{n(p, t)} + b \Big)

with the taps t of the kernel and the neighbour n(p, t) of point p; a neighbour outside the grid is
a row of zeros. Taps that are outside at every point are left out, and batch normalisation is part
of W and b. The decoder gathers from the coarser field directly: the neighbour of p there is the
coarse point that n(p, t) belongs to.

Loads whose grids together are large are left to PyTorch, whose convolutions of many are faster.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import torch
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from torch import nn

from surrogate.networks.unet import TRANSFORMS, UNet
from surrogate.one_load.reduced_in_numpy import ACTIVATIONS, Activation, Array, Single, array

GATHERED = 2**17  # values gathered at once: 0.5 MB, a part of a core's cache
BY_PYTORCH, AT_ONCE = 2**11, 2**16  # fewest and most grid points of loads convolved by PyTorch
Numbers = NDArray[np.int64]


class Source(NamedTuple):
    """What a convolution reads of one field.

    Attributes
    ----------
    rows : array of int, (n_points, n_taps)
        Neighbours of every point in the field.
    matrix : array, (n_taps · inputs, outputs)
    """

    rows: Numbers
    matrix: Single


class Convolution(NamedTuple):
    """A convolution of one field, or of several beside one another, with its activation.

    Attributes
    ----------
    sources : tuple of Source
        One a field.
    bias : array, (outputs,)
    activation : callable
    """

    sources: tuple[Source, ...]
    bias: Single
    activation: Activation

    def of(self, *fields: Single) -> Single:
        """Convolve: (N, n_rows, inputs) each → (N, n_points + 1, outputs); last rows are zero."""
        loads, points = len(fields[0]), len(self.sources[0].rows)
        y = np.empty((loads, points + 1, len(self.bias)), np.float32)
        y[:, :-1], y[:, -1] = self.bias, 0
        for (rows, matrix), x in zip(self.sources, fields, strict=True):
            step = max(1, GATHERED // (len(matrix) * loads))
            for start in range(0, points, step):
                some = rows[start : start + step]
                gathered = x.take(some, axis=1).reshape(-1, len(matrix))
                y[:, start : start + len(some)] += (gathered @ matrix).reshape(loads, len(some), -1)
        self.activation(y[:, :-1])
        return y

    @property
    def gathered(self) -> int:
        """Largest number of values that are gathered for one load."""
        return max(len(rows) * len(matrix) for rows, matrix in self.sources)


class UNetInNumPy:
    """A U-Net in evaluation, from the input grid to the output grid of some loads.

    Parameters
    ----------
    unet : UNet
        Network without random weights or masks; its weights are copied.
    shape : tuple of int
        Number of grid points along every axis.
    outputs : int
        Number of output channels to compute, the first ones.

    Attributes
    ----------
    at_once : int
        Number of loads that are convolved together here: what is gathered for them stays in the
        cache.
    """

    def __init__(self, unet: UNet, shape: tuple[int, ...], outputs: int) -> None:
        self.unet, self.shape, self.outputs = unet, shape, outputs
        count, outside = len(unet.encoder), int(np.prod(shape))
        pads = np.reshape(unet.pads(torch.Size(shape)), (-1, 2))[::-1]  # before and after each axis
        padded = np.array(shape) + pads.sum(axis=1)
        shapes = [tuple(padded // 2**level) for level in range(count)]
        on_grid = np.pad(np.arange(outside).reshape(shape), pads, constant_values=outside).ravel()
        self.rows = np.flatnonzero(on_grid < outside)
        self.transformed = None if unet.transform is TRANSFORMS["linear"] else unet.transformed
        self.children = [children(fine) for fine in shapes[:-1]]
        near = [neighbours(shape) for shape in shapes]
        of_input = np.append(on_grid, outside)[near[0]]

        self.encoder: list[tuple[Convolution, Convolution]] = []
        for level, layers in enumerate(unet.encoder):
            first, second = convolutions(layers)
            rows = near[level] if level else of_input
            self.encoder.append((first.reading(rows), second.reading(near[level])))
        self.decoder: list[tuple[Convolution, Convolution]] = []
        for level, layers in zip(reversed(range(count - 1)), unet.decoder, strict=True):
            first, second = convolutions(layers)
            coarse = parents(self.children[level])[near[level]]
            joined = first.reading(coarse, near[level], first=len(self.encoder[level + 1][1].bias))
            self.decoder.append((joined, second.reading(near[level])))
        every = [layer.gathered for pair in (*self.encoder, *self.decoder) for layer in pair]
        self.at_once = max(1, GATHERED // max(every))
        head = array(unet.head.weight)[:outputs].reshape(outputs, -1)
        self.head: Single = np.ascontiguousarray(head.T, np.float32)
        self.head_bias: Single = array(unet.head.bias)[:outputs].astype(np.float32)

    def __call__(self, fields: Single) -> Single:
        """Predict from the fields of some loads, in scaled units.

        Parameters
        ----------
        fields : array, (N, n_points, inputs) or (n_points, inputs)
            Input at the grid points, in the order of a flattened (nx, ny[, nz]).

        Returns
        -------
        array, (N, n_points, outputs) or (n_points, outputs)
        """
        if fields.ndim == 2:
            return self(fields[None])[0]
        step, points = self.at_once, fields.shape[0] * fields.shape[1]
        if len(fields) > 1 and points >= BY_PYTORCH:
            parts = np.array_split(fields, -(-points // AT_ONCE)) if points > AT_ONCE else [fields]
            return np.concatenate([self.by_pytorch(part) for part in parts])
        if len(fields) > step:
            return np.concatenate(
                [self(fields[start : start + step]) for start in range(0, len(fields), step)]
            )
        if self.transformed is not None:
            points = torch.from_numpy(fields).flatten(0, 1)
            fields = self.transformed(points).numpy().reshape(*fields.shape[:2], -1)
        outside = np.zeros((len(fields), 1, fields.shape[2]), np.float32)
        x: Single = np.concatenate((fields, outside), axis=1)
        skipped = []
        with np.errstate(over="ignore"):  # exp(-x) of SiLU may be infinite
            for level, (first, second) in enumerate(self.encoder):
                if level:
                    skipped.append(x)
                    x = pooled(x, self.children[level - 1])
                x = second.of(first.of(x))
            for first, second in self.decoder:
                x = second.of(first.of(x, skipped.pop()))
        return x.take(self.rows, axis=1) @ self.head + self.head_bias

    @torch.inference_mode()
    def by_pytorch(self, fields: Single) -> Single:
        """Predict in PyTorch, (N, n_points, inputs) → (N, n_points, outputs)."""
        x = torch.from_numpy(fields).transpose(1, 2).reshape(len(fields), -1, *self.shape)
        y = self.unet(x)[:, : self.outputs].flatten(2).transpose(1, 2)
        return np.ascontiguousarray(y.numpy())


# --- points of the levels; of n points, number n is the row of zeros ---------------------------


def neighbours(shape: tuple[int, ...]) -> Numbers:
    """Numbers of a grid's points around every point, and itself: (n_points, 3^d)."""
    count = int(np.prod(shape))
    numbers = np.pad(np.arange(count).reshape(shape), 1, constant_values=count)
    return sliding_window_view(numbers, (3,) * len(shape)).reshape(count, -1)


def children(shape: tuple[int, ...]) -> Numbers:
    """Numbers of the fine points of every coarse point: (2^d, n_coarse)."""
    d = len(shape)
    halves = [part for n in shape for part in (n // 2, 2)]
    numbers = np.arange(np.prod(shape)).reshape(halves)
    return numbers.transpose(*range(1, 2 * d, 2), *range(0, 2 * d, 2)).reshape(2**d, -1)


def parents(of_coarse: Numbers) -> Numbers:
    """Numbers of the coarse point of every fine point, and of the row of zeros."""
    found = np.empty(of_coarse.size + 1, np.int64)
    found[of_coarse] = np.arange(of_coarse.shape[1])
    found[-1] = of_coarse.shape[1]
    return found


def pooled(x: Single, of_coarse: Numbers) -> Single:
    """Take the largest of the 2^d points of every coarser point, with rows of zeros."""
    y = np.zeros((len(x), of_coarse.shape[1] + 1, x.shape[2]), np.float32)
    x.take(of_coarse, axis=1).max(axis=1, out=y[:, :-1])
    return y


# --- weights ----------------------------------------------------------------------------------


class Layer(NamedTuple):
    """Kernel (outputs, inputs, 3, 3[, 3]), bias and activation of a convolution."""

    kernel: Array
    bias: Single
    activation: Activation

    def reading(self, *rows: Numbers, first: int | None = None) -> Convolution:
        """Make the convolution of fields, of which the first one has so many channels."""
        kernels = np.split(self.kernel, [] if first is None else [first], axis=1)
        sources = tuple(map(source_of, kernels, rows))
        return Convolution(sources, self.bias, self.activation)


def source_of(kernel: Array, rows: Numbers) -> Source:
    """Make what is read of a field, without the taps that are outside the grid everywhere."""
    inside = (rows < rows.max()).any(axis=0)  # the centre is inside, the corners are outside
    taps = kernel.reshape(*kernel.shape[:2], -1)[:, :, inside]
    matrix = np.ascontiguousarray(taps.transpose(2, 1, 0).reshape(-1, len(kernel)), np.float32)
    return Source(np.ascontiguousarray(rows[:, inside]), matrix)


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
