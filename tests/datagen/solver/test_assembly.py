"""Assembly by the loop in C against dolfinx's own assembly."""

from __future__ import annotations

from collections.abc import Callable

import dolfinx
import numpy as np
import pytest
from dolfinx.fem import petsc as fem_petsc

from datagen.solver.equilibrium import EquilibriumProblem
from shared_schema.materials import Volumetric


@pytest.mark.parametrize("volumetric", ["paper", "quadratic"])
@pytest.mark.parametrize(
    ("elements", "upper"), [((4, 3), (2.0, 1.0)), ((3, 3, 2), (2.0, 1.0, 1.0))]
)
def test_same_matrix_as_dolfinx(
    make_problem: Callable[..., EquilibriumProblem],
    elements: tuple[int, ...],
    upper: tuple[float, ...],
    volumetric: Volumetric,
) -> None:
    """Entries are equal up to the order of summation; clamped rows are those of the identity."""
    problem = make_problem(elements, upper, volumetric=volumetric, distortion=0.05)
    random = np.random.default_rng(0)
    for scale in (0.0, 0.03):
        shape = problem.mesh.coordinates.shape
        problem.set_displacement(
            random.normal(scale=scale, size=shape) if scale else np.zeros(shape)
        )
        ours = problem.tangent()
        space = problem.u.function_space
        clamped = np.isclose(problem.mesh.coordinates[problem.numbering.node_of_block, 0], 0.0)
        blocks = np.flatnonzero(clamped).astype(np.int32)
        support = dolfinx.fem.dirichletbc(np.zeros(problem.dimension), blocks, space)
        theirs = fem_petsc.assemble_matrix(problem.forms.tangent, bcs=[support])
        theirs.assemble()
        assert np.abs(ours[:, :] - theirs[:, :]).max() < 1e-12 * theirs.norm()
