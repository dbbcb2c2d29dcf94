"""The same equilibria by another finite-element library (scikit-fem), its tangent by hand.

P = μ (F − F⁻ᵀ) + p F⁻ᵀ and its derivative

    dP = μ dF + (μ − p) F⁻ᵀ dFᵀ F⁻ᵀ + p' (F⁻ᵀ : dF) F⁻ᵀ

with p = λ/2 (J² − 1), p' = λ J² (paper) or p = λ (J² − J), p' = λ (2 J² − J) (quadratic).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.typing import NDArray
from scipy.sparse.linalg import splu
from skfem import (
    Basis,
    BilinearForm,
    ElementHex1,
    ElementQuad1,
    ElementVector,
    LinearForm,
    MeshHex,
    MeshQuad,
)
from skfem.helpers import ddot, det, grad, inv, mul, transpose

from datagen.body import make_body
from datagen.case import read_case
from datagen.geometries import Box
from datagen.load_stepping import solve_load_case
from datagen.material import NeoHookean, Volumetric

Vector = NDArray[np.float64]


def by_scikit_fem(
    box: Box, material: NeoHookean, point: tuple[float, ...], force: Vector
) -> tuple[Vector, Vector]:
    """Node positions and displacements, (n_nodes, d), of a box clamped at its lower x."""
    lines = [
        np.linspace(a, b, n + 1) for a, b, n in zip(box.lower, box.upper, box.elements, strict=True)
    ]
    d = box.dimension
    mesh = (MeshQuad if d == 2 else MeshHex).init_tensor(*lines)
    basis = Basis(mesh, ElementVector(ElementQuad1() if d == 2 else ElementHex1()), intorder=2)
    lam, mu = material.lame_lambda, material.lame_mu
    quadratic = material.volumetric == "quadratic"

    def state(w: Any) -> tuple[Any, Any, Any, Any]:
        f = grad(w["u"]) + np.eye(d)[:, :, None, None]
        j = det(f)
        p, dp = (
            (lam * (j**2 - j), lam * (2 * j**2 - j))
            if quadratic
            else (lam / 2 * (j**2 - 1), lam * j**2)
        )
        return f, transpose(inv(f)), p, dp

    def internal(v: Any, w: Any) -> Any:
        f, g, p, _ = state(w)
        return ddot(mu * (f - g) + p * g, grad(v))

    def tangent(u: Any, v: Any, w: Any) -> Any:
        _, g, p, dp = state(w)
        df = grad(u)
        turned = mul(mul(g, transpose(df)), g)
        return ddot(mu * df + (mu - p) * turned + dp * ddot(g, df) * g, grad(v))

    forces, matrix = LinearForm(internal), BilinearForm(tangent)
    node = int(np.linalg.norm(mesh.p.T - point, axis=1).argmin())
    load = np.zeros(basis.N)
    load[basis.nodal_dofs[:, node]] = force
    free = basis.complement_dofs(basis.get_dofs(lambda x: np.isclose(x[0], box.lower[0])))
    u = np.zeros(basis.N)
    for _ in range(30):
        residual = (forces.assemble(basis, u=basis.interpolate(u)) - load)[free]
        if np.linalg.norm(residual) < 1e-10:
            return mesh.p.T, u[basis.nodal_dofs].T
        stiffness = matrix.assemble(basis, u=basis.interpolate(u))[free][:, free]
        u[free] -= splu(stiffness.tocsc()).solve(residual)
    raise AssertionError("scikit-fem did not converge")


@pytest.mark.slow
@pytest.mark.parametrize("volumetric", ["paper", "quadratic"])
@pytest.mark.parametrize(
    ("name", "elements", "point", "force", "largest"),
    [
        ("beam2d", (15, 3), (4.0, 1.0), (1.2, -2.3), 0.95),
        ("beam2d", (15, 3), (4.0, 1.0), (-2.5, 2.5), 1.2),
        ("beam3d", (14, 5, 5), (4.0, 0.4, 1.0), (-1.6, 1.2, -1.9), 1.1),
    ],
)
def test_same_displacements(
    name: str,
    elements: tuple[int, ...],
    point: tuple[float, ...],
    force: tuple[float, ...],
    largest: float,
    volumetric: Volumetric,
) -> None:
    """Equal to 1e-8 m at every node, where the body moves as far as in the paper's examples."""
    case = read_case(name, volumetric=volumetric)
    assert isinstance(case.mesh, Box)
    box = case.mesh.model_copy(update={"elements": elements})
    solver = case.solver.model_copy(update={"tolerance": 1e-10})
    case = case.model_copy(update={"mesh": box, "solver": solver})
    body = make_body(case, MPI.COMM_SELF)
    x = body.mesh.coordinates
    node = int(np.linalg.norm(x - point, axis=1).argmin())
    assert solve_load_case(body.problem, np.array([node]), np.array([force]), solver).solved
    ours = body.problem.displacement()
    at, theirs = by_scikit_fem(box, case.material, point, np.asarray(force))
    order, their_order = (np.lexsort(positions.round(6).T) for positions in (x, at))
    assert x[order] == pytest.approx(at[their_order], abs=1e-9)
    assert np.linalg.norm(ours[node]) > 0.9 * largest
    assert np.abs(ours[order] - theirs[their_order]).max() < 1e-8
