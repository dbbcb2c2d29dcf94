r"""A body in modes of its displacement: equilibrium of few unknowns, by a few of its cells.

With modes φ and their coefficients q, the displacement is :math:`u = \sum_k q_k φ_k`, and

.. math:: R(q) = Φ^T f_{int}(Φ q) - Φ^T f - \sum_i a_i \, Φ^T g_i(Φ q) = 0

with dead forces f and loads of the amplitudes a that follow the body
(`surrogate.mechanics.equilibrium.following_loads`). The internal forces are those of a few cells,
whose weights make the works on the modes right in the states that the modes come from (Farhat,
Avery, Chapman and Cortial 2014, *Dimensional reduction of nonlinear finite element dynamic models
with finite rotations and energy-based mesh sampling and weighting*). The cells are those of any
material and element (`surrogate.mechanics.compiled.solid`); Taylor and Hood's elements, whose
dilations are one field, have all of them. Works of pressures are polynomials of q, and those of
cables depend on their legs alone (`surrogate.mechanics.series.following_terms`): both are exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from shared_schema.common.bodies.following_loads import FollowingLoad
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.modal_equilibrium import fit_cubature
from surrogate.mechanics.series.following_terms import FollowingTerms
from surrogate.mechanics.solids.mixed_elements import TaylorHoodSolid
from surrogate.mechanics.solids.solid import Solid

Array = NDArray[np.float64]
LEFT_OUT = 3e-5  # of the states' square, at most, that modes leave out
MOST_MODES = 60
CELLS_OF_A_MODE = 5  # at most
STATES = 64  # of the fit of the weights, at most
EQUATIONS = 12  # of the fit of the weights, of every cell


@dataclass(frozen=True)
class CellSample:
    """Cells whose forces stand for those of all.

    Attributes
    ----------
    cells : array of int, (n,)
    weights : array, (n,)
        Factors on their forces.
    """

    cells: NDArray[np.int64]
    weights: Array


class ReducedBody:
    """Forces, and their derivatives, of a body in modes.

    Parameters
    ----------
    equilibrium : Equilibrium
    units : sequence of FollowingLoad
        Actuators of unit amplitude.
    modes : array, (n_modes, n_points, d)
        In m, of every coefficient.
    sample : CellSample

    Attributes
    ----------
    elements : Solid
        Of the sampled cells; their volumes are weighted.
    points : array of int
        Numbers of the points of these cells.
    at_nodes : array, (n_points · d, n_modes)
        Modes there.
    """

    def __init__(
        self,
        equilibrium: Equilibrium,
        units: Sequence[FollowingLoad],
        modes: Array,
        sample: CellSample,
    ) -> None:
        self.equilibrium, self.units, self.modes = equilibrium, tuple(units), modes
        geometry, chosen = equilibrium.geometry, sample.cells
        nodes, cells = np.unique(geometry.cells[chosen], return_inverse=True)
        parts = None if geometry.parts is None else geometry.parts[chosen]
        fibres = None if geometry.fibres is None else geometry.fibres[chosen]
        if isinstance(equilibrium.solid, TaylorHoodSolid):
            solid: Solid = equilibrium.solid
        else:
            body = geometry.coordinates[nodes], cells.reshape(-1, geometry.cells.shape[1])
            kind = type(equilibrium.solid)
            solid = kind(*body, geometry.cell_type, equilibrium.material, parts, fibres)
            solid.volumes *= torch.from_numpy(sample.weights)[:, None]
        self.elements, self.points = solid, nodes
        self._solid, self._shape = solid.compiled, (len(nodes), modes.shape[2])
        self.at_nodes = np.ascontiguousarray(modes[:, nodes].reshape(len(modes), -1).T)
        of_cells = modes[:, nodes][:, solid.cells.numpy()]
        self._at_cells = np.ascontiguousarray(
            of_cells.reshape(len(modes), len(solid.cells), -1).transpose(1, 2, 0)
        )
        self._pressed, self._cables = self._works_of_units()

    def displacement(self, q: Array) -> Array:
        """Displacement of all points in m: (n_modes,) → (n_points, d)."""
        return np.tensordot(q, self.modes, 1)

    def works_of(self, forces: Array) -> Array:
        """Works of dead forces on the modes, in J: (n_points, d) in N → (n_modes,)."""
        return np.tensordot(self.modes, forces, 2)

    def internal(self, q: Array) -> Array | None:
        """Works of the internal forces in J, (n_modes,); None where a cell is inverted."""
        state = self._solid.deformed((self.at_nodes @ q).reshape(self._shape))
        if not state.inside:
            return None
        return self.at_nodes.T @ self._solid.forces(self._solid.first_piola(state)).ravel()

    def tangent(self, q: Array) -> Array:
        """Derivative of `internal`, (n_modes, n_modes) in J."""
        u = (self.at_nodes @ q).reshape(1, *self._shape)
        of_cells = self._solid.cell_tangents(u)[0].numpy()
        at_cells = self._at_cells
        if of_cells.shape[1] > at_cells.shape[1]:
            at_cells = self._with_dilations(of_cells)
        turned = np.matmul(of_cells, at_cells)
        return np.asarray(at_cells.reshape(-1, len(q)).T @ turned.reshape(-1, len(q)))

    def _with_dilations(self, of_cells: Array) -> Array:
        r"""Modes at the cells of Taylor and Hood's elements, with the dilations that they cause.

        Tangents of cells are those of u, θ and p. With :math:`θ_k = M^{-1} B^T φ_k`, which the row
        of p says, the works on the modes are those of the condensed tangent for any p, here 0.
        """
        solid, (_, rows, modes) = self.elements, self._at_cells.shape
        corners = solid.corners.numpy()
        of_modes = of_cells[:, -corners.shape[1] :, :rows] @ self._at_cells
        sums = np.zeros((int(corners.max()) + 1, modes))
        np.add.at(sums, corners, of_modes)
        dilations = solid.solved_mass(sums)[corners]
        return np.concatenate([self._at_cells, dilations, np.zeros_like(dilations)], axis=1)

    def _works_of_units(self) -> tuple[dict[int, Array], dict[int, Array]]:
        """Works of pressures on the modes, and legs of cables in modes, by number of the unit.

        Works are (m + 1, m + 1, m), legs (n_legs, m + 1, d): at rest first, of m modes.
        """
        pressed, cables = {}, {}
        fields = [torch.from_numpy(mode)[None] for mode in self.modes]
        for number, unit in enumerate(self.units):
            terms = FollowingTerms(self.equilibrium.geometry.coordinates, [unit])
            works = terms.works(torch.ones(1, 1, dtype=torch.float64), fields)
            if works.legs is None:
                pressed[number] = works.pressed[0].numpy()
            else:
                cables[number] = works.legs[0].numpy()
        return pressed, cables

    def following(self, q: Array) -> Array:
        """Works of the units on the modes: (n_modes,) → (n_units, n_modes)."""
        moved, found = np.concatenate([[1.0], q]), np.zeros((len(self.units), len(q)))
        for number, works in self._pressed.items():
            found[number] = moved @ np.tensordot(moved, works, 1)
        for number, legs in self._cables.items():
            e = moved @ legs
            unit = e / np.linalg.norm(e, axis=1, keepdims=True)
            found[number] = -np.tensordot(unit, legs[:, 1:], ((0, 1), (0, 2)))
        return found

    def following_slopes(self, q: Array, amplitudes: Array) -> Array:
        """Derivatives of the works under amplitudes, (n_modes, n_modes) in J."""
        moved, found = np.concatenate([[1.0], q]), np.zeros((len(q), len(q)))
        for number, works in self._pressed.items():
            of_state = np.tensordot(moved, works, 1) + np.tensordot(moved, works, (0, 1))
            found += amplitudes[number] * of_state[1:].T
        for number, legs in self._cables.items():
            e, terms = moved @ legs, legs[:, 1:]
            length = np.linalg.norm(e, axis=1)
            n = e / length[:, None]
            across = terms - (terms @ n[:, :, None]) * n[:, None]
            scaled = across * (amplitudes[number] / length)[:, None, None]
            found -= np.tensordot(scaled, across, ((0, 2), (0, 2)))
        return found

    def quantities(self, q: Array) -> Array:
        """Lengths in m and volumes in m³ of the units, (n_units,)."""
        x = self.equilibrium.geometry.coordinates + self.displacement(q)
        return np.array([unit.quantity(x) for unit in self.units])


def modes_of(states: Array, most: int = MOST_MODES) -> Array:
    """Leading modes of some displacements: (n_states, n_points, d) → (n_modes, n_points, d).

    The coefficients of a state have its size in m.
    """
    flat = states.reshape(len(states), -1)
    values, vectors = np.linalg.eigh(flat @ flat.T)
    order = np.argsort(-values)
    values, vectors = np.maximum(values[order], 0), vectors[:, order]
    left = 1 - np.cumsum(values) / values.sum()
    count = min(most, int(np.searchsorted(-left, -(LEFT_OUT**2))) + 1, int((values > 0).sum()))
    modes = vectors[:, :count].T @ flat / np.sqrt(values[:count, None])
    largest = np.linalg.norm(modes.reshape(count, *states.shape[1:]), axis=2).max(1)
    return (modes / largest[:, None]).reshape(count, *states.shape[1:])


def sampled_cells(
    equilibrium: Equilibrium,
    units: Sequence[FollowingLoad],
    modes: Array,
    coefficients: Array,
    amplitudes: Array,
    seed: int = 0,
) -> CellSample:
    """Choose cells and their weights, by what their forces do to some states.

    Parameters
    ----------
    equilibrium : Equilibrium
    units : sequence of FollowingLoad
    modes : array, (n_modes, n_points, d)
    coefficients : array, (n_states, n_modes)
        Of states in equilibrium.
    amplitudes : array, (n_states, n_units)
        Under which they are.
    seed : int
        Of the combinations of the equations of a state.
    """
    solid, count = equilibrium.solid, len(equilibrium.geometry.cells)
    every = CellSample(np.arange(count), np.ones(count))
    if isinstance(solid, TaylorHoodSolid):
        return every
    whole = ReducedBody(equilibrium, units, modes, every)
    rng, wanted = np.random.default_rng(seed), CELLS_OF_A_MODE * len(modes)
    some = slice(None, None, -(-len(coefficients) // STATES))
    each = max(1, EQUATIONS * wanted // len(coefficients[some]))
    of_cells = modes[:, equilibrium.geometry.cells]
    columns, totals = [], []
    for q, a in zip(coefficients[some], amplitudes[some], strict=True):
        k = whole.tangent(q) - whole.following_slopes(q, a)
        path = solid.path(torch.from_numpy(whole.displacement(q))[None])
        forces = solid.of_cells(path.stress[:, :, 0])[:, 0].mT.numpy()
        works = np.einsum("mcbi,cbi->mc", of_cells, forces)
        size = np.linalg.norm(q) * np.sqrt(each)
        equations = rng.normal(size=(each, len(modes))) @ np.linalg.solve(k, works) / size
        columns.append(equations)
        totals.append(equations.sum(axis=1))
    size = float(np.sqrt(np.mean([np.square(total).sum() for total in totals])))
    columns.append(np.full((1, count), size / count))
    totals.append(np.array([size]))
    kept, weights = fit_cubature(np.concatenate(columns), np.concatenate(totals), wanted)
    order = np.argsort(kept)
    return CellSample(kept[order], weights[order])
