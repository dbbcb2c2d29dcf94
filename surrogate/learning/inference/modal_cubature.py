"""The equilibrium in modes of a reduced network, by a cubature that `surrogate balance` fits."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError
from surrogate.learning.networks.reduced_at_nodes import nodal_modes
from surrogate.learning.networks.reduced_network import ReducedNetwork
from surrogate.mechanics.modal_equilibrium import BalancedCoefficients, Cubature, ModalEquilibrium
from surrogate.runtime.tensor_file import load_tensors

if TYPE_CHECKING:
    from surrogate.learning.inference.surrogate import Surrogate

Array = NDArray[np.float64]


def balance(surrogate: Surrogate, cubature: Cubature) -> None:
    """Let a network predict coefficients of least energy, by a cubature of the least energy."""
    network = surrogate.network
    assert isinstance(network.network, ReducedNetwork)
    body = equilibrium_of(surrogate, modes_of(surrogate), cubature)
    scale = float(network.displacement_scale.flatten()[0])
    network.network.equilibrium = BalancedCoefficients(body, float(network.force_scale) * scale)


def read_cubature(path: Path) -> Cubature:
    """Read the file of a cubature in a run folder; InputError if it is damaged."""
    tensors, _ = load_tensors(path)
    try:
        return Cubature(*(tensors[name].numpy() for name in Cubature._fields))
    except KeyError as error:
        raise InputError(f"{path}: damaged (no {error})") from None


def modes_of(surrogate: Surrogate) -> Array:
    """Displacements in m of the modes of a reduced network, (m, n_nodes, d)."""
    return nodal_modes(surrogate.predictor.network).transpose(1, 2).double().cpu().numpy()


def equilibrium_of(surrogate: Surrogate, modes: Array, cubature: Cubature) -> ModalEquilibrium:
    """Equilibrium in modes (m, n_nodes, d) in m, with the energy at the points of a cubature."""
    solid = surrogate.body.equilibrium.solid
    return ModalEquilibrium(
        modes,
        solid.cells.numpy(),
        solid.gradients.numpy(),
        cubature,
        solid.laws,
        surrogate.geometry.parts,
    )
