r"""Prediction of displacements under one load or some in NumPy, where PyTorch takes more time.

A prediction has three parts, in `OneLoad.__call__`: what is computed before the network (its inputs
and the response :math:`u_0` of the body, the linear one or the load series), the network N on the
grid, and the map back to the nodes,

.. math:: u = u_0 + B \, s \, a \, N(x)

with the scale s and the amplitude a of the output (`surrogate.networks.field_network`). On an
embedded grid the supports of the last term are held (`surrogate.networks.held_nodes`). Each part
is the fastest of those that a benchmark compares (`docs/benchmarks/one-load.md`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from surrogate.networks.field_network import TINY
from surrogate.networks.nodal_network import NodalNetwork
from surrogate.networks.reduced_network import ReducedNetwork
from surrogate.networks.unet import UNet
from surrogate.one_load.large_body import LargeBody
from surrogate.one_load.reduced_in_numpy import ReducedInNumPy
from surrogate.one_load.small_body import SmallBody
from surrogate.one_load.unet_in_numpy import UNetInNumPy
from surrogate.probabilistic.ensemble import Ensemble

SMALLEST = np.float32(TINY)
TOGETHER = 64  # loads that are predicted together: a solve reads its factor once for them
BY_PYTORCH = 32  # the same, of loads that PyTorch predicts
Single = NDArray[np.float32]
Array = NDArray[np.float64]
GridFunction = Callable[[Single], Single]  # (N, n_points, inputs) to (N, n_points, outputs)


class BeforeNetwork(Protocol):
    """What is computed before the network."""

    def known(self, forces: Array) -> NDArray[np.bool_]:
        """Tell which loads, (N, n_nodes, d), are computed here; PyTorch is as fast for others."""

    def __call__(self, forces: Array) -> tuple[Single, Array | None]:
        """Return inputs and response from forces in N, (N, n_nodes, d), of known loads.

        Returns
        -------
        inputs : array, (N, n_points, inputs)
            Of the network, scaled but for the gradient of a series' last term.
        response : array, (N, n_nodes, d), or None
            In m; None if the network's output is the displacement itself.
        """


class OneLoad:
    """The mean displacements under one load, or some together.

    Parameters
    ----------
    network : NodalNetwork
        Network on the CPU that is not stochastic; its weights are copied.
    members : list of callable
        Its networks on the grid, from `in_numpy`.
    """

    def __init__(self, network: NodalNetwork, members: list[GridFunction]) -> None:
        self.network, self.members = network, members
        field = network.network
        self.last_gradient = field.last_gradient
        self.linear_gradient = field.channels.get("linear_gradient")
        self.linear_share = np.float32(0 if field.linear_share is None else field.linear_share)
        d, weights = len(field.displacement_scale), network.to_nodes.weights.numpy()
        scale = (field.displacement_scale * field.movable).reshape(d, -1).numpy().T
        self.sources = network.to_nodes.sources.numpy().reshape(weights.shape)
        self.scales = weights[:, :, None] * scale[self.sources] / np.float32(len(members))
        self.before = before_network(network)

    def __call__(self, forces: Array) -> Array:
        """Predict displacements in m from forces in N, both (n_nodes, d)."""
        return self.several(forces[None])[0]

    def several(self, forces: Array) -> Array:
        """Predict displacements in m from forces in N, both (N, n_nodes, d).

        Every load is computed as it is alone. What loads share, matrices and factors, is read once
        for many, which differs by rounding.
        """
        known = self.before.known(forces)
        displacement = np.empty(forces.shape)
        for numbers, at_once, predict in (
            (known.nonzero()[0], TOGETHER, self._together),
            ((~known).nonzero()[0], BY_PYTORCH, self.by_pytorch),
        ):
            for start in range(0, len(numbers), at_once):
                some = numbers[start : start + at_once]
                displacement[some] = predict(forces[some])
        return displacement

    def _together(self, forces: Array) -> Array:
        """Predict for known loads."""
        inputs, response = self.before(forces)
        if self.last_gradient is None:
            y = self._output(inputs)
        else:
            last = inputs[..., self.last_gradient]
            amplitude = largest(last)
            last /= amplitude + SMALLEST
            if self.linear_share:
                amplitude = amplitude + self.linear_share * largest(
                    inputs[..., self.linear_gradient]
                )
            y = self._output(inputs) * amplitude
        u = y.take(self.sources[0], axis=1) * self.scales[0]
        for sources, scales in zip(self.sources[1:], self.scales[1:], strict=True):
            u += y.take(sources, axis=1) * scales
        u = u.astype(np.float64)
        if self.network.held is not None:
            u = self.network.held.of_some(u)
        return u if response is None else u + response

    def _output(self, inputs: Single) -> Single:
        """Sum what the members have on the grid."""
        y = self.members[0](inputs)
        for member in self.members[1:]:
            y += member(inputs)
        return y

    @torch.inference_mode()
    def by_pytorch(self, forces: Array) -> Array:
        """Predict with the network in PyTorch, (N, n_nodes, d)."""
        mean, _ = self.network(torch.from_numpy(forces.astype(np.float32)))
        return mean.mean(dim=0).double().numpy()


def before_network(network: NodalNetwork) -> BeforeNetwork:
    """Choose what computes a network's inputs and the response of its body."""
    if SmallBody.fits(network):
        return SmallBody(network)
    return LargeBody(network) if LargeBody.fits(network) else InputsByPyTorch(network)


def largest(gradient: Single) -> Single:
    """Largest norm of gradients on the grid: (N, n_points, d²) → (N, 1, 1)."""
    return np.sqrt((gradient * gradient).sum(axis=2).max(axis=1))[:, None, None]


class InputsByPyTorch:
    """Inputs and response by PyTorch: of U-Nets on large bodies."""

    def __init__(self, network: NodalNetwork) -> None:
        self.network, self.field = network, network.network

    def known(self, forces: Array) -> NDArray[np.bool_]:
        """All loads."""
        return np.ones(len(forces), bool)

    @torch.inference_mode()
    def __call__(self, forces: Array) -> tuple[Single, Array | None]:
        """Return inputs and response."""
        force = self.network.on_grid(torch.from_numpy(forces.astype(np.float32)))
        linear = self.network.linear_response(force)
        inputs, response = self.field.inputs_of(force, linear)
        if self.field.last_gradient is None:
            inputs = self.field.scaled(inputs)
        fields = np.ascontiguousarray(inputs.flatten(2).transpose(1, 2).numpy())
        if response is None:
            return fields, None
        nodal = self.network.at_nodes(response * self.field.movable, linear)
        return fields, nodal.transpose(1, 2).double().numpy()


def in_numpy(network: nn.Module, shape: tuple[int, ...], outputs: int) -> list[GridFunction] | None:
    """Copy the members of a network as functions on the grid; None if its kind has no such form.

    Parameters
    ----------
    network : nn.Module
        Network without random weights or masks.
    shape : tuple of int
        Number of grid points along every axis.
    outputs : int
        Number of output channels to compute, the first ones.
    """
    if isinstance(network, ReducedNetwork):
        return [ReducedInNumPy(network, shape)]
    members = list(network.members) if isinstance(network, Ensemble) else [network]
    unets = [member for member in members if isinstance(member, UNet)]
    if len(unets) < len(members):
        return None
    return [UNetInNumPy(unet, shape, outputs) for unet in unets]
