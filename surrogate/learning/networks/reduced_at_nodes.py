r"""A reduced network between fields at the nodes, on a CPU, for loads without gradients.

.. math:: u = u_1 + V c(E^T f)

The response :math:`u_1` of the undeformed body, the encoder E and the modes V are those of
`surrogate.learning.networks.reduced_network`, taken from the grid to the nodes once. A load on a
few nodes needs a few rows of E, and columns of K⁻¹ that are kept; no field passes over the grid.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from surrogate.learning.networks.field_network import at_points, on_grid
from surrogate.learning.networks.nodal_network import NodalNetwork
from surrogate.learning.networks.reduced_network import ReducedNetwork
from surrogate.mechanics.equilibrium.compliance import Compliance
from surrogate.mechanics.equilibrium.kept_responses import KeptResponses
from surrogate.mechanics.equilibrium.linear_response import LinearResponse
from surrogate.mechanics.series.series_response import SeriesResponse

TOGETHER = 64  # loads that are predicted together: matrices and factors are read once for them
INPUTS = ("force",), ("response", "shape")
SPARSE = 4  # inputs for every loaded one, from which on loads take rows of the encoder
Array = NDArray[np.float64]


class ReducedAtNodes:
    """Forces at the nodes to mean displacements there.

    Parameters
    ----------
    network : NodalNetwork
        For which `fits` is true; its weights are copied.
    """

    def __init__(self, network: NodalNetwork) -> None:
        reduced, linear = network.network.network, network.network.linear
        assert isinstance(reduced, ReducedNetwork)
        assert isinstance(linear, LinearResponse)
        self.network, self.reduced, self.linear = network, reduced, linear
        self.encoder = of_nodal_forces(network, encoder_of_forces(network))
        self.modes = nodal_modes(network).transpose(1, 2).flatten(1).contiguous()
        self.compliance: Compliance | None = None
        maps = network.to_nodes, network.to_grid, linear.to_grid, linear.to_nodes
        if all(sums.selects for sums in maps):
            assert isinstance(linear.compliance, Compliance)
            self.compliance = linear.compliance
        self.kept = KeptResponses(self._responses, len(self.encoder))

    @cached_property
    def _works(self) -> NDArray[np.float32]:
        """Forces to the scaled work on the modes, for an equilibrium in these."""
        return of_nodal_forces(self.network, self.reduced.modes)

    @staticmethod
    def fits(network: NodalNetwork) -> bool:
        """Whether a network is such a one, on a CPU, without random weights."""
        field = network.network
        is_reduced = isinstance(field.network, ReducedNetwork) and field.inputs in INPUTS
        is_linear = isinstance(field.linear, LinearResponse)
        is_linear = is_linear and not isinstance(field.linear, SeriesResponse)
        return is_reduced and is_linear and field.skip and field.free.device.type == "cpu"

    def __call__(self, forces: Array) -> Array:
        """Predict displacements in m from forces in N, both (N, n_nodes, d)."""
        if len(forces) <= TOGETHER:
            return self._together(forces)
        parts = np.split(forces, range(TOGETHER, len(forces), TOGETHER))
        return np.concatenate([self._together(part) for part in parts])

    @torch.inference_mode()
    def _together(self, forces: Array) -> Array:
        force = forces.astype(np.float32)
        flat: NDArray[np.float32] = force.reshape(len(force), -1)
        some: slice | NDArray[np.int64] = slice(None)
        loaded = np.flatnonzero(flat.any(axis=0))
        if SPARSE * len(loaded) < flat.shape[1]:
            flat, some = flat[:, loaded], loaded
        encoded = torch.from_numpy(flat @ self.encoder[some])
        mean = self.reduced.corrected(encoded)[:, : len(self.modes)]
        if self.reduced.members > 1:
            mean = mean.reshape(self.reduced.members, len(force), -1).mean(dim=0)
        if self.reduced.equilibrium is not None:
            mean = self.reduced.equilibrium(torch.from_numpy(flat @ self._works[some]), mean)
        u = torch.addmm(torch.from_numpy(self._response(force)), mean, self.modes)
        return u.numpy().astype(np.float64).reshape(forces.shape)

    def _response(self, force: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return u₁ in m, (N, n_nodes · d), of forces in N."""
        if self.compliance is not None:
            return self.compliance.respond(force).reshape(len(force), -1)
        return self.kept.answers(force.reshape(len(force), -1))

    @torch.inference_mode()
    def _responses(self, forces: NDArray[Any]) -> NDArray[np.float32]:
        """Solve for u₁ on an embedded grid: (N, n_nodes · d) → same."""
        network, movable = self.network, self.network.network.movable
        grid = network.on_grid(torch.from_numpy(forces).reshape(len(forces), -1, len(movable)))
        nodal = network.linear_response(grid)
        displacement = self.linear(grid)[0] if nodal is None else self.linear.on_grid(nodal)[0]
        u = network.at_nodes(displacement * movable, nodal)
        return np.asarray(u.transpose(1, 2).flatten(1).numpy())


@torch.inference_mode()
def encoder_of_forces(network: NodalNetwork) -> Tensor:
    """Encoder of scaled forces on the grid, also of a network whose input is the response to them.

    As the response S is symmetric, rows E of a function of responses are rows E S of forces.
    """
    field, reduced = network.network, network.network.network
    assert isinstance(reduced, ReducedNetwork)
    if "response" not in field.channels or field.linear is None:
        return reduced.encoder
    rows = on_grid(reduced.encoder, reduced.points, field.movable[None])
    responses = at_points(field.linear(rows)[0], reduced.points)
    return responses * (field.force_scale / field.displacement_rms)


def of_nodal_forces(network: NodalNetwork, of_grid: Tensor) -> NDArray[np.float32]:
    """Make linear functions of scaled forces on the grid ones of nodal forces, (n_nodes · d, m).

    They are given by rows of the free points, component by component, (m, d · n_free).
    """
    reduced, movable = network.network.network, network.network.movable
    assert isinstance(reduced, ReducedNetwork)
    placed = on_grid(of_grid / network.network.force_scale, reduced.points, movable[None])
    rows = network.to_nodes(placed.flatten(2)).transpose(1, 2).flatten(1)
    return np.ascontiguousarray(rows.T.numpy())


@torch.inference_mode()
def nodal_modes(network: NodalNetwork) -> Tensor:
    """Displacements in m of the modes of a reduced network, (m, d, n_nodes)."""
    field = network.network
    reduced = field.network
    assert isinstance(reduced, ReducedNetwork)
    fields = on_grid(reduced.modes, reduced.points, field.movable[None])
    return network.at_nodes(fields * field.displacement_scale * field.movable)
