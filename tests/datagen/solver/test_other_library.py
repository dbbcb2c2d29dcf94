"""The same equilibria by another finite-element library, scikit-fem, with a tangent by hand.

The stress is P = μ (F − F⁻ᵀ) + p F⁻ᵀ and its derivative

    dP = μ dF + (μ − p) F⁻ᵀ dFᵀ F⁻ᵀ + p' (F⁻ᵀ : dF) F⁻ᵀ

with p = λ/2 (J² − 1), p' = λ J² (paper) or p = λ (J² − J), p' = λ (2 J² − J) (quadratic).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
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
    ElementTetP1,
    ElementTriP1,
    ElementVector,
    LinearForm,
    MeshTet,
    MeshTri,
)
from skfem.helpers import ddot, det, grad, inv, mul, transpose
from skfem.io.meshio import from_meshio

from datagen.cases.body import Body, make_body
from datagen.cases.case import Case, read_case
from datagen.mesh.distributed_mesh import Mesh
from datagen.mesh.geometries import Box
from datagen.mesh.mesh_file import MeshFile
from datagen.solver.load_stepping import solve_load_case
from shared_schema.materials import NeoHookean, Volumetric

Vector = NDArray[np.float64]
ELEMENTS = {
    "quad": ElementQuad1,
    "hexahedron": ElementHex1,
    "triangle": ElementTriP1,
    "tetra": ElementTetP1,
}
LOAD_STEPS = 4


def by_scikit_fem(
    mesh: Mesh, clamped: NDArray[np.bool_], material: NeoHookean, node: int, force: Vector
) -> Vector:
    """Solve for the displacement, (n_nodes, d) in m, of a body under a force at one node."""
    d = mesh.coordinates.shape[1]
    theirs = from_meshio(meshio.Mesh(mesh.coordinates, {mesh.cell_type: mesh.cells}))
    assert np.array_equal(theirs.p.T, mesh.coordinates)
    basis = Basis(theirs, ElementVector(ELEMENTS[mesh.cell_type]()), intorder=2)
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
    load = np.zeros(basis.N)
    load[basis.nodal_dofs[:, node]] = force
    free = basis.nodal_dofs[:, ~clamped].ravel()
    u = np.zeros(basis.N)
    for factor in np.linspace(0.0, 1.0, LOAD_STEPS + 1)[1:]:
        for _ in range(30):
            at = basis.interpolate(u)
            residual = (forces.assemble(basis, u=at) - factor * load)[free]
            if np.linalg.norm(residual) < 1e-10:
                break
            stiffness = matrix.assemble(basis, u=at)[free][:, free]
            u[free] -= splu(stiffness.tocsc()).solve(residual)
        else:
            raise AssertionError("scikit-fem did not converge")
    return np.asarray(u[basis.nodal_dofs].T)


def coarser(case: Case, elements: tuple[int, ...]) -> Case:
    """Copy a case with another number of elements along each axis."""
    assert isinstance(case.mesh, Box)
    return case.model_copy(update={"mesh": case.mesh.model_copy(update={"elements": elements})})


def assert_same_displacements(
    case: Case, point: tuple[float, ...], force: tuple[float, ...], largest: float
) -> None:
    """Assert displacements equal to 1e-8 m at every node; the loaded node moves by `largest` m."""
    solver = case.solver.model_copy(update={"tolerance": 1e-10})
    body: Body = make_body(case.model_copy(update={"solver": solver}), MPI.COMM_SELF)
    node = int(np.linalg.norm(body.mesh.coordinates - point, axis=1).argmin())
    assert solve_load_case(body.problem, np.array([node]), np.array([force]), solver).solved
    ours = body.problem.displacement()
    assert np.linalg.norm(ours[node]) == pytest.approx(largest, rel=0.01)
    assert isinstance(case.material, NeoHookean)
    theirs = by_scikit_fem(body.mesh, body.clamped, case.material, node, np.asarray(force))
    assert np.abs(ours - theirs).max() < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("volumetric", ["paper", "quadratic"])
@pytest.mark.parametrize(
    ("name", "elements", "point", "force", "largest"),
    [
        ("beam2d", (15, 3), (4.0, 1.0), (1.2, -2.3), 0.935),
        ("beam2d", (15, 3), (4.0, 1.0), (-2.5, 2.5), 1.376),
        ("beam3d", (14, 5, 5), (4.0, 0.4, 1.0), (-1.6, 1.2, -1.9), 1.36),
    ],
)
def test_boxes(
    name: str,
    elements: tuple[int, ...],
    point: tuple[float, ...],
    force: tuple[float, ...],
    largest: float,
    volumetric: Volumetric,
) -> None:
    """Boxes that move as far as in the paper's examples."""
    case = coarser(read_case(name, volumetric=volumetric), elements)
    assert_same_displacements(case, point, force, largest)


@pytest.mark.slow
@pytest.mark.parametrize("volumetric", ["paper", "quadratic"])
def test_lshape(volumetric: Volumetric) -> None:
    """The tip moves by 2.39 m, as in the paper's example of the L-shape."""
    case = read_case("lshape2d", volumetric=volumetric)
    assert_same_displacements(case, (6.0, 2.0), (-0.07, -1.0), 2.39)


@pytest.mark.slow
@pytest.mark.parametrize("volumetric", ["paper", "quadratic"])
@pytest.mark.parametrize(
    ("name", "mesh", "point", "force", "largest"),
    [
        ("beam2d", (MeshTri, (31, 7)), (4.0, 1.0), (1.2, -2.3), 0.922),
        ("beam3d", (MeshTet, (13, 4, 4)), (4.0, 1.0, 1.0), (-1.6, 1.2, -1.9), 1.054),
    ],
)
def test_simplices(
    tmp_path: Path,
    name: str,
    mesh: tuple[Any, tuple[int, ...]],
    point: tuple[float, ...],
    force: tuple[float, ...],
    largest: float,
    volumetric: Volumetric,
) -> None:
    """Beams of triangles and tetrahedra, read from a file, with inner nodes moved at random."""
    kind, counts = mesh
    lines = [np.linspace(0, end, n) for end, n in zip((4, 1, 1), counts, strict=False)]
    regular = kind.init_tensor(*lines)
    inner = np.ones(regular.p.shape[1], dtype=bool)
    inner[regular.boundary_nodes()] = False
    points = regular.p.T.copy()
    points[inner] += np.random.default_rng(7).uniform(-0.03, 0.03, points[inner].shape)
    cell_type = {MeshTri: "triangle", MeshTet: "tetra"}[kind]
    meshio.write_points_cells(tmp_path / "beam.vtu", points, {cell_type: regular.t.T})
    geometry = MeshFile(kind="file", path="beam.vtu").found_from(tmp_path)
    case = read_case(name, volumetric=volumetric).model_copy(update={"mesh": geometry})
    assert_same_displacements(case, point, force, largest)
