r"""Prediction of the displacements under one load in NumPy, where PyTorch's calls take most time.

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
AT_ONCE = 64  # loads whose corrections are held at once
BLOCK = 32  # loads of a batch from which on PyTorch is faster for U-Nets
Single = NDArray[np.float32]
Array = NDArray[np.float64]
GridFunction = Callable[[Single], Single]  # (n_points, inputs) to (n_points, outputs)


class BeforeNetwork(Protocol):
    """What is computed before the network."""

    def __call__(self, forces: Array) -> tuple[Single, Array | None] | None:
        """Return inputs and response from forces in N, (n_nodes, d).

        Returns
        -------
        inputs : array, (n_points, inputs)
            Of the network, scaled but for the gradient of a series' last term.
        response : array, (n_nodes, d), or None
            In m; None if the network's output is the displacement itself.

        None in place of both under loads for which PyTorch is as fast.
        """


class OneLoad:
    """The mean displacements under one load.

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
        d, weights = len(field.displacement_scale), network.to_nodes.weights.numpy()
        scale = (field.displacement_scale * field.movable).reshape(d, -1).numpy().T
        self.sources = network.to_nodes.sources.numpy().reshape(weights.shape)
        self.scales = weights[:, :, None] * scale[self.sources] / np.float32(len(members))
        self.before = before_network(network)

    def __call__(self, forces: Array) -> Array:
        """Predict displacements in m from forces in N, both (n_nodes, d)."""
        found = self.before(forces)
        if found is None:
            return self.by_pytorch(forces)
        inputs, response = found
        amplitude = np.float32(1)
        if self.last_gradient is not None:
            last = inputs[:, self.last_gradient]
            amplitude = np.sqrt((last * last).sum(axis=1).max())
            last /= amplitude + SMALLEST
        y = self.members[0](inputs)
        for member in self.members[1:]:
            y += member(inputs)
        return self.at_nodes(y * amplitude, response)

    def several(self, forces: Array, by_pytorch: Callable[[Array], Array]) -> Array:
        """Predict displacements in m from forces in N, both (N, n_nodes, d).

        Loads are predicted one by one, so that each has the same result as alone. The dense layers
        and the modes of a reduced network take some together, which differs from that by rounding
        in single precision.

        Parameters
        ----------
        by_pytorch : callable
            It does the same in PyTorch, for those batches that are faster there.
        """
        network = self.members[0]
        if not isinstance(network, ReducedInNumPy):
            one_by_one = len(forces) < BLOCK
            return np.stack([self(f) for f in forces]) if one_by_one else by_pytorch(forces)
        displacement = np.empty(forces.shape)
        left = []
        for start in range(0, len(forces), AT_ONCE):
            found = {k: self.before(forces[k]) for k in range(start, len(forces))[:AT_ONCE]}
            left += [k for k, before in found.items() if before is None]
            given = [(k, *before) for k, before in found.items() if before is not None]
            if not given:
                continue
            encoded = np.stack([network.encoded(inputs) for _, inputs, _ in given])
            for (k, inputs, response), y in zip(given, network.corrections(encoded), strict=True):
                displacement[k] = self.at_nodes(y.reshape(inputs.shape), response)
        if left:
            displacement[left] = by_pytorch(forces[left])
        return displacement

    def at_nodes(self, y: Single, response: Array | None) -> Array:
        """Displacements in m of what the network has on the grid, and of the body's response."""
        u = (y.take(self.sources, axis=0) * self.scales).sum(axis=0).astype(np.float64)
        if self.network.held is not None:
            u = self.network.held.of_one(u)
        return u if response is None else u + response

    @torch.inference_mode()
    def by_pytorch(self, forces: Array) -> Array:
        """Predict with the network in PyTorch."""
        mean, _ = self.network(torch.from_numpy(forces.astype(np.float32))[None])
        return mean.mean(dim=0)[0].double().numpy()


def before_network(network: NodalNetwork) -> BeforeNetwork:
    """Choose what computes a network's inputs and the response of its body."""
    if SmallBody.fits(network):
        return SmallBody(network)
    return LargeBody(network) if LargeBody.fits(network) else InputsByPyTorch(network)


class InputsByPyTorch:
    """Inputs and response by PyTorch: of U-Nets on large bodies."""

    def __init__(self, network: NodalNetwork) -> None:
        self.network, self.field = network, network.network

    @torch.inference_mode()
    def __call__(self, forces: Array) -> tuple[Single, Array | None]:
        """Return inputs and response."""
        force = self.network.on_grid(torch.from_numpy(forces.astype(np.float32))[None])
        linear = self.network.linear_response(force)
        inputs, response = self.field.inputs_of(force, linear)
        if self.field.last_gradient is None:
            inputs = self.field.scaled(inputs)
        fields = np.ascontiguousarray(inputs.flatten(2)[0].T.numpy())
        if response is None:
            return fields, None
        nodal = self.network.at_nodes(response * self.field.movable, linear)
        return fields, nodal[0].T.double().numpy()


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
