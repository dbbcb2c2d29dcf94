"""Stresses and reactions of given displacements, as the factory's finite elements have them."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from shared_schema.common.bodies.equilibrium import stress_fields
from shared_schema.common.bodies.reference_cells import CORNERS, LINEAR
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.energy.law import law_of
from surrogate.mechanics.solids.deformation import Deformation, completed, determinant
from surrogate.mechanics.solids.elements import gradients_at
from surrogate.mechanics.solids.mixed_elements import MeanDilationSolid, TaylorHoodSolid
from surrogate.mechanics.solids.solid import Solid

Array = NDArray[np.float64]


def cell_stresses(solid: Solid, geometry: Geometry, displacement: Array) -> dict[str, Array]:
    """Fields of stress at the middle of every cell, where the volumes of cells change: of F̄.

    Parameters
    ----------
    solid : Solid
    geometry : Geometry
    displacement : array, (N, n_nodes, d)
        In m.

    Returns
    -------
    dict of array, (N, n_cells, …)
        By the names of `shared_schema.common.bodies.equilibrium`.
    """
    cell_type = LINEAR.get(geometry.cell_type, geometry.cell_type)
    middle = np.mean(CORNERS[cell_type], axis=0)[None]
    mesh = geometry.coordinates, geometry.cells, geometry.cell_type
    gradients = gradients_at(*mesh, middle)[0][:, 0]
    h = np.einsum("ncbi,cbj->ijcn", displacement[:, geometry.cells], gradients)
    identity = np.eye(geometry.dimension)[:, :, None, None]
    gradient = torch.from_numpy(h + identity)
    if isinstance(solid, MeanDilationSolid | TaylorHoodSolid):  # F̄ of the cell's dilation
        ratio = solid.dilation(torch.from_numpy(displacement)) / determinant(gradient)
        gradient = ratio ** (1 / geometry.dimension) * gradient
    f, fibres = completed(gradient), solid.fibres
    if fibres is not None:
        fibres = fibres[..., 0]
        if fibres.shape[1] == 2:  # in the plane
            fibres = torch.cat([fibres, torch.zeros_like(fibres[:, :1])], dim=1)
    p, w = torch.empty_like(f), torch.empty_like(f[0, 0])
    of_cells = solid.material_of_cells()
    for number, material in enumerate(solid.materials):
        law, some = law_of(material, 3), of_cells == number
        directions = None if fibres is None else fibres[: law.families, :, some]
        state = Deformation(f[:, :, some], fibres=directions)
        p[:, :, some], w[some] = state.stress(law.stress(state.measures)), state.energy(law)
    gradients, piola = (each.permute(3, 2, 0, 1).numpy() for each in (f, p))
    return stress_fields(gradients, piola, w.T.numpy())


def reactions(solid: Solid, geometry: Geometry, displacement: Array, acting: Array) -> Array:
    """Forces of the supports on the body: (N, n_nodes, d) in N, zero where nothing is held.

    Parameters
    ----------
    solid : Solid
    geometry : Geometry
    displacement : array, (N, n_nodes, d)
        In m.
    acting : array, (N, n_nodes, d)
        Forces in N, with those that pressures have on the deformed body. What of them acts where
        the body is held, the supports bear as well.
    """
    internal = solid.internal_forces(torch.from_numpy(displacement)).numpy()
    return np.where(geometry.held, internal - acting, 0.0)
