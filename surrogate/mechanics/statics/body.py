"""A body: its equilibria, the errors of displacements, stresses and reactions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from shared_schema.common.arguments import real_numbers
from shared_schema.common.bodies.equilibrium import ForceTolerance
from shared_schema.common.errors import InputError
from shared_schema.common.units import Units
from shared_schema.grid import Grid, grid_arrays
from shared_schema.materials import Materials, materials_of
from surrogate.mechanics.body.elements_of_case import (
    has_points_between,
    require_known_elements,
    with_dilations,
    with_elements,
)
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.body.stiffness import case_of_moduli
from surrogate.mechanics.equilibrium.compliance import Compliance
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.statics.load import Load, checked_loads, fields_at_nodes

if TYPE_CHECKING:
    from surrogate.mechanics.certify import Certificate, Correction
    from surrogate.mechanics.descent import Aim, Descent, DrivenBody

Array = NDArray[np.float64]
CPU = torch.device("cpu")
LARGE = 20000  # components whose stiffness is not factorised for a load like those of a training


class Remade:
    """What is computed once and kept is no part of a copy."""

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what is computed at first use: a copy computes it again."""
        return {
            name: value
            for name, value in self.__dict__.items()
            if not isinstance(getattr(type(self), name, None), cached_property)
        }


class Body(Remade):
    """Mesh, supports, elements and material, without a way to predict.

    Parameters
    ----------
    geometry : Geometry
    case : mapping
        The case's elements, materials, units and tolerance of the solver.
    shared : sequence of Compliance
        Those of a predictor, whose factors of K(0) are taken if they are the body's.
    device : torch.device
        Where a predictor computes; on a GPU, fast estimates solve there as well.
    """

    def __init__(
        self,
        geometry: Geometry,
        case: Mapping[str, Any],
        shared: Sequence[Compliance] = (),
        device: torch.device = CPU,
    ) -> None:
        self.geometry, self.case, self._shared, self._device = geometry, case, shared, device

    @classmethod
    def read(cls, folder: str | Path) -> Body:
        """Read the body of a dataset, or of a folder that `datagen body` has made.

        Raises
        ------
        InputError
            If there is none, or a file is damaged.
        """
        from shared_schema.dataset_reader import DatasetReader

        reader = DatasetReader(Path(folder))
        case, arrays = reader.manifest.case, reader.body
        if reader.manifest.kind == "nodal":
            arrays |= grid_arrays(Grid.in_a_row(*arrays["mesh/coordinates"].shape))
        geometry = Geometry.from_arrays(arrays, reader.cell_type)
        return cls(with_elements(geometry, case, reader.manifest.forces), case)

    def with_young_moduli(self, moduli: Mapping[str, float]) -> Body:
        """The body with other Young's moduli at rest in Pa, by group of its materials.

        Raises
        ------
        InputError
            If it is of one material, there is no such group, or a modulus is not positive and
            finite.
        """
        return Body(self.geometry, case_of_moduli(self.case, self.material, moduli))

    def of_shape(self, parameters: Mapping[str, float]) -> Body:
        """The body in the shape of some parameters, the others in the middle of their ranges.

        Raises
        ------
        InputError
            If it has one shape, there is no such parameter, or they tangle the mesh.
        """
        return Body(self.geometry.of_shape(parameters), self.case)

    @property
    def material(self) -> Materials:
        """Material of the body, or those of its parts; InputError if they are not shipped ones."""
        return materials_of(self.case.get("material"), "material of the run's case")

    @property
    def units(self) -> Units:
        """Labels of the units of the case."""
        return Units.of_case(self.case)

    @cached_property
    def equilibrium(self) -> Equilibrium:
        """The finite-element equilibrium of the body.

        Raises
        ------
        InputError
            If its material is none of the shipped ones, or the learner does not compute the
            equilibria of its elements.
        """
        require_known_elements(self.case)
        geometry = with_dilations(self.geometry, self.case)
        between = has_points_between(self.case, geometry.cell_type)
        found = None
        for one in (compliance.equilibrium for compliance in self._shared):
            is_alike = (one.points is not None) == between
            if is_alike and one.mean_dilation == geometry.mean_dilation:
                found = one
        found = found or Equilibrium(geometry, self.material, between)
        found.units = self.units
        return found

    def under(self, following: FollowingLoads | None) -> Equilibrium:
        """Equilibrium under dead loads, and under the following loads of one case if there are."""
        return self.equilibrium if following is None else self.equilibrium.under(following)

    @cached_property
    def driven_body(self) -> DrivenBody:
        """The body as directions see it; InputError as `equilibrium`."""
        from surrogate.mechanics.descent import DrivenBody

        return DrivenBody.of(self.equilibrium)

    def descend(
        self, load: Load, predicted: Array, aim: Aim, last_term: float = math.inf
    ) -> tuple[Array, Descent]:
        """Drive the prediction of one load towards the equilibrium, by directions.

        Parameters
        ----------
        load : Load
        predicted : array, (n_nodes, d)
            In m.
        aim : Aim
        last_term : float
            What the last term of the prediction's series adds at most, in m; infinite if it is
            not one.

        Raises
        ------
        InputError
            As `equilibrium`.
        """
        from surrogate.mechanics.descent import descend

        body = self.driven_body.under(load.following)
        if not all(law.is_smooth for law in self.equilibrium.solid.laws):
            last_term = math.inf  # a series does not see where fibres begin to bear
        return descend(body, load.dead, predicted, aim, last_term)

    @property
    def is_small(self) -> bool:
        """Whether K(0) is factorised in no time."""
        return self.geometry.coordinates.size <= LARGE

    def one_direction(self, load: Load, displacement: Array) -> Array | None:
        """Estimated error in m by one direction; None if the learner does not know the body."""
        from surrogate.mechanics.descent.first_direction import first_direction

        try:
            body = self.driven_body.under(load.following)
        except InputError:
            return None
        found = first_direction(body, load.dead, displacement)
        return np.full(displacement.shape, np.inf) if found is None else -found

    def certify(self, load: Load, displacement: Array) -> Certificate:
        """Estimate the errors of displacements in m from their out-of-balance forces.

        Parameters
        ----------
        load : Load
        displacement : array, (n_nodes, d) or (N, n_nodes, d)

        Raises
        ------
        InputError
            As `equilibrium`.
        """
        from surrogate.mechanics.certify.full_certificate import certify

        return certify(self.equilibrium, load.dead, displacement, load.following)

    def correct(self, load: Load, displacement: Array) -> Correction:
        """Go on from a displacement in m, (n_nodes, d), to the equilibrium under one load.

        Directions go to the end where they are set up, and a tangent takes longer to factorise.

        Raises
        ------
        InputError
            As `equilibrium`.
        WorkError
            If no equilibrium is found.
        """
        from surrogate.mechanics.certify.correction import Correction, correct
        from surrogate.mechanics.descent.equilibria import equilibria, sought
        from surrogate.mechanics.descent.trust import is_narrow

        tolerance, body = ForceTolerance.of_case(self.case), self.under(load.following)
        if "driven_body" in vars(self) and not is_narrow(body):
            driven = self.driven_body.under(load.following)
            search = sought(driven, load.dead, displacement, tolerance)
            for _, found in equilibria(driven.compliance, [search]):
                if found is not None:
                    of = found.displacement, "prediction", found.directions, found.residual_norm
                    return Correction(*of, units=body.units, by="directions")
        return correct(body, load.dead, displacement, tolerance)

    def stresses(
        self,
        displacement: ArrayLike | Tensor,
        forces: ArrayLike | Tensor | None = None,
        *,
        pressure: ArrayLike | None = None,
    ) -> dict[str, Array]:
        """Compute stresses at the middle of every cell.

        Parameters
        ----------
        displacement : array, (n_nodes, d) or (N, n_nodes, d)
            In m.
        forces : array, (n_nodes or n_points, d) or with N before, optional
            Loads in N, as of `Surrogate.certify`. They matter to elements with points between the
            nodes alone, which move under the forces there; none by default.
        pressure : array, (n_surfaces,) or (N, n_surfaces), optional
            Pressures in Pa that are a part of these loads; none by default.

        Returns
        -------
        dict of array, (n_cells, …) or (N, n_cells, …)
            By the names of `shared_schema.common.bodies.equilibrium`.

        Raises
        ------
        InputError
            If a shape is wrong, or the material is none of the shipped ones.
        """
        u = fields_at_nodes(self.geometry, displacement, "displacements")
        given = self.geometry.no_pressure if pressure is None else pressure
        load = Load.told_apart(self.geometry, self._load_on(u, forces), given)
        fields = self.stresses_under(load, u)
        return {name: values[0] if u.ndim == 2 else values for name, values in fields.items()}

    def reactions(
        self,
        displacement: ArrayLike | Tensor,
        pushed: ArrayLike | Tensor | None = None,
        *,
        forces: ArrayLike | Tensor | None = None,
    ) -> Array:
        """Compute the forces of the supports on the body in N, of the displacements' shape.

        Parameters
        ----------
        displacement : array, (n_nodes, d) or (N, n_nodes, d)
            In m.
        pushed : array of the same shape, optional
            Forces in N of pressures on the deformed body, with n_points rows on elements with
            points between the nodes; none by default.
        forces : array, (n_nodes or n_points, d) or with N before, optional
            Dead loads in N, which matter as to `stresses`; none by default.

        Raises
        ------
        InputError
            As `stresses`.
        """
        from surrogate.mechanics.equilibrium.stresses import reactions

        u, body = fields_at_nodes(self.geometry, displacement, "displacements"), self.equilibrium
        nodes, d = self.geometry.coordinates.shape
        loads = self._load_on(u, forces)
        acting = body.forces_at_points(loads.reshape(-1, *loads.shape[-2:])).copy()
        if pushed is not None:
            of_pressures = real_numbers(pushed, "forces of pressures")
            several, rows = u.shape[:-2], of_pressures.shape[-2:-1]
            if of_pressures.shape != (*several, *rows, d) or rows[0] not in (nodes, len(body.free)):
                raise InputError(
                    f"forces of pressures have shape {of_pressures.shape}, expected {u.shape}"
                )
            acting[:, : rows[0]] += of_pressures.reshape(-1, *rows, d)
        at_points = body.at_points(u.reshape(-1, nodes, d), acting)
        found = reactions(self.equilibrium.solid, body.geometry, at_points, acting)
        return np.asarray(body.forces_at_nodes(found).reshape(u.shape))

    def _load_on(self, u: Array, forces: ArrayLike | Tensor | None) -> Array:
        """Loads on displacements of some shape; InputError unless they are as many."""
        if forces is None:
            return np.zeros(u.shape)
        loads = checked_loads(self.geometry, forces)
        if loads.shape[:-2] != u.shape[:-2]:
            raise InputError(f"forces have shape {loads.shape}, expected {u.shape}")
        return loads

    def _under_load(self, load: Load, u: Array) -> tuple[Array, Array]:
        """Displacements of all points in m, and all forces on them in N: (N, n_points, d) each."""
        body, following = self.equilibrium, load.following
        u = u.reshape(-1, *self.geometry.coordinates.shape)
        f = body.forces_at_points(load.cases.dead)
        if following is None:
            return body.at_points(u, f), f
        at_points = np.empty(f.shape)
        for row in range(len(u)):
            one = slice(row, row + 1)
            under = body.under(following[one])
            at_points[one] = under.at_points(u[one], f[one])
            f[one] = under.external(at_points[one], f[one])
        return at_points, f

    def stresses_under(self, load: Load, u: Array) -> dict[str, Array]:
        """Stresses of N displacements in m, (N, n_nodes, d), under their loads.

        By name, (N, n_cells, …); of a single displacement, (n_nodes, d), that of N = 1.
        """
        from surrogate.mechanics.equilibrium.stresses import cell_stresses

        at_points, _ = self._under_load(load, u)
        return cell_stresses(self.equilibrium.solid, self.equilibrium.geometry, at_points)

    def reactions_under(self, load: Load, u: Array) -> Array:
        """Reactions in N of the same displacements, of their shape."""
        from surrogate.mechanics.equilibrium.stresses import reactions

        body = self.equilibrium
        found = reactions(body.solid, body.geometry, *self._under_load(load, u))
        return np.asarray(body.forces_at_nodes(found).reshape(u.shape))
