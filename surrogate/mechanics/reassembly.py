"""Tensors of a network that follow from mesh and material, for files that leave them out.

A small run folder does not hold the compliance of its linear response: it is computed again from
the stiffness of the undeformed body when the run is loaded.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from shared_schema.material import NeoHookean
from surrogate.data.geometry import Geometry
from surrogate.mechanics.equilibrium import Equilibrium
from surrogate.mechanics.linear_response import LinearResponse
from surrogate.networks.field_network import FieldNetwork

COMPLIANCE = "linear.compliance"  # among the tensors of a `FieldNetwork`


def without_reassembled(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Leave out the tensors of a network that `with_reassembled` can add."""
    return {name: tensor for name, tensor in tensors.items() if name != COMPLIANCE}


def with_reassembled(
    tensors: Mapping[str, Tensor],
    network: FieldNetwork,
    geometry: Geometry,
    case: Mapping[str, Any],
) -> dict[str, Tensor]:
    """Add the tensors that were left out.

    Parameters
    ----------
    tensors : mapping of str to Tensor
        Tensors of the network.
    network : FieldNetwork
    geometry : Geometry
    case : mapping
        Configuration of the case, for its material.
    """
    complete = dict(tensors)
    if isinstance(network.linear, LinearResponse) and COMPLIANCE not in complete:
        material = NeoHookean.model_validate(case["material"])
        complete[COMPLIANCE] = compliance(geometry, material).float()
    return complete


def compliance(geometry: Geometry, material: NeoHookean) -> Tensor:
    """Return K⁻¹ in m/N of the free nodes, by component, then by node, in double precision."""
    free, d = np.flatnonzero(~geometry.clamped), geometry.dimension
    columns = np.arange(d * len(free))
    forces = np.zeros((len(columns), len(geometry.coordinates), d))
    forces[columns, free[columns % len(free)], columns // len(free)] = 1.0
    response = Equilibrium(geometry, material).linear_response(forces)[:, free]
    return torch.from_numpy(response.swapaxes(1, 2).reshape(len(columns), -1))
