"""Equilibrium of a Neo-Hookean solid: material, assembly, linear solver, load stepping."""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from datagen.solver.equilibrium import EquilibriumProblem
    from datagen.solver.load_stepping import solve_from, solve_load_case
    from datagen.solver.settings import SolverSettings
    from datagen.solver.strain_energy import deformation_gradient, energy_density

__all__ = [
    "EquilibriumProblem",
    "SolverSettings",
    "deformation_gradient",
    "energy_density",
    "solve_from",
    "solve_load_case",
]
__getattr__, __dir__ = lazy_names(__name__)
