"""The stiffness of the undeformed body, held against linear elasticity and tiny loads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from scipy.sparse import csr_array
from scipy.sparse.linalg import spsolve

from datagen.cases.body import Body
from datagen.cases.case import read_case
from datagen.farm.farm import run
from datagen.mesh.geometries import Box
from datagen.output.undeformed_stiffness import stiffness_of
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.settings import SolverSettings
from datagen.transforms.reindexing import structure
from shared_schema.checker import check_dataset
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.files import sha256
from shared_schema.dataset_reader import DatasetReader
from shared_schema.manifest import read_manifest
from shared_schema.materials import NeoHookean, Volumetric
from shared_schema.shard import read_shard
from shared_schema.stiffness import read_stiffness, stiffness_problems

MATERIAL = NeoHookean(young_modulus=500, poisson_ratio=0.4)


def matrix_of(mesh: RawMesh, material: NeoHookean = MATERIAL) -> csr_array:
    stiffness = stiffness_of(mesh, material)
    assert stiffness_problems(stiffness, mesh.coordinates.size) == []
    return csr_array((stiffness.data, stiffness.indices, stiffness.indptr))


def box(*elements: int) -> RawMesh:
    d = len(elements)
    return Box(lower=(0.0,) * d, upper=(2.0, 1.0, 1.0)[:d], elements=elements).raw_mesh()


def rigid_modes(x: np.ndarray) -> np.ndarray:
    """Translations, and rotations u_i = x_j, u_j = -x_i: (modes, n_nodes · d)."""
    d = x.shape[1]
    modes = [np.tile(e, (len(x), 1)) for e in np.eye(d)]
    for i, j in zip(*np.tril_indices(d, -1), strict=True):
        rotation = np.zeros_like(x)
        rotation[:, i], rotation[:, j] = x[:, j], -x[:, i]
        modes.append(rotation)
    return np.array(modes).reshape(len(modes), -1)


@pytest.mark.parametrize("elements", [(4, 3), (3, 2, 2)])
def test_rigid_modes_are_all_that_costs_no_force(elements: tuple[int, ...]) -> None:
    """3 of them in the plane, 6 in space; every other eigenvalue is positive."""
    mesh = box(*elements)
    k = matrix_of(mesh)
    modes = rigid_modes(mesh.coordinates)
    assert np.abs(k @ modes.T).max() < 1e-11 * np.abs(k.data).max()
    eigenvalues = np.linalg.eigvalsh(k.toarray())
    assert len(modes) == {2: 3, 3: 6}[len(elements)]
    assert np.abs(eigenvalues[: len(modes)]).max() < 1e-11 * eigenvalues[-1]
    assert eigenvalues[len(modes)] > 1e-4 * eigenvalues[-1]


@pytest.mark.parametrize("volumetric", ["paper", "quadratic"])
def test_patch_of_uniform_stretch(volumetric: Volumetric) -> None:
    """Plane strain, ε_xx = 1: σ_xx = λ + 2μ and σ_yy = λ on the sides of a 2 x 1 m box.

    Both volumetric terms have U''(1) = λ. The nodes inside feel no force.
    """
    material = MATERIAL.model_copy(update={"volumetric": volumetric})
    mesh = box(4, 3)
    x = mesh.coordinates
    stretched = np.stack([x[:, 0], np.zeros(len(x))], axis=1)
    force = (matrix_of(mesh, material) @ stretched.ravel()).reshape(-1, 2)
    lam, mu = 500 * 0.4 / (1.4 * 0.2), 500 / 2.8
    right, top = np.isclose(x[:, 0], 2), np.isclose(x[:, 1], 1)
    assert force[right, 0].sum() == pytest.approx((lam + 2 * mu) * 1.0)
    assert force[top, 1].sum() == pytest.approx(lam * 2.0)
    inside = ~(right | top | np.isclose(x[:, 0], 0) | np.isclose(x[:, 1], 0))
    assert np.abs(force[inside]).max() < 1e-9


@pytest.mark.parametrize("elements", [(4, 3), (3, 2, 2)])
def test_numbered_as_the_nodes_are(elements: tuple[int, ...]) -> None:
    """Nodes that no cell shares are not coupled; with other numbers it is the same matrix."""
    mesh = box(*elements)
    k, d = matrix_of(mesh), len(elements)
    nodes = len(mesh.coordinates)
    coupled = np.zeros((nodes, nodes), dtype=bool)
    for cell in mesh.cells:
        coupled[np.ix_(cell, cell)] = True
    row, column = k.tocoo().row // d, k.tocoo().col // d
    assert coupled[row, column].all()
    order = np.random.default_rng(0).permutation(nodes)  # new number of every node
    coordinates = np.empty_like(mesh.coordinates)
    coordinates[order] = mesh.coordinates
    other = matrix_of(RawMesh(coordinates, order[mesh.cells], mesh.cell_type))
    dofs = (order[:, None] * d + np.arange(d)).ravel()
    assert np.abs(other[dofs][:, dofs] - k).max() < 1e-12 * np.abs(k.data).max()


def test_tiny_load_is_linear(beam: Body) -> None:
    """|u − K⁻¹ f| / |u| of the nonlinear solution is proportional to f, and tends to zero."""
    mesh = beam.mesh
    k = matrix_of(RawMesh(mesh.coordinates, mesh.cells, mesh.cell_type))
    free = np.flatnonzero(np.repeat(~beam.clamped, 2))
    node = int(np.flatnonzero(beam.loadable)[-1])
    problem = EquilibriumProblem(mesh, MATERIAL, beam.clamped, SolverSettings(tolerance=1e-12))
    differences = []
    for newtons in (1e-4, 1e-3):
        force = np.zeros(mesh.coordinates.size)
        force[2 * node : 2 * node + 2] = newtons
        problem.set_load(np.array([node]), np.full((1, 2), newtons))
        assert problem.solve(1.0).converged
        u = problem.displacement().ravel()
        linear = np.zeros_like(u)
        linear[free] = spsolve(k[free][:, free].tocsc(), force[free])
        differences.append(np.linalg.norm(u - linear) / np.linalg.norm(u))
    assert differences[0] < 1e-4
    assert differences[1] / differences[0] == pytest.approx(10, rel=0.1)


@pytest.mark.parametrize("case", ["beam2d", "plate2d"])
def test_in_the_nodal_dataset(tmp_path: Path, case: str) -> None:
    """The file holds what is assembled on the mesh of the shards, to the last bit."""
    manifest = run(read_case(case, samples=4), tmp_path / "nodal", comm=MPI.COMM_SELF)
    assert check_dataset(tmp_path / "nodal") == []
    reader = DatasetReader(tmp_path / "nodal")
    mesh = RawMesh(reader.body["mesh/coordinates"], reader.body["mesh/cells"], reader.cell_type)
    found, expected = read_stiffness(reader.folder), stiffness_of(mesh, MATERIAL)
    assert manifest.stiffness == sha256(tmp_path / "nodal" / "stiffness.h5")
    assert np.array_equal(found.data, expected.data)
    assert np.array_equal(found.indices, expected.indices)
    assert np.array_equal(found.indptr, expected.indptr)


def test_in_the_structured_dataset(tmp_path: Path) -> None:
    """The mesh's own, whatever the order of the nodes on the grid; found damaged by the checker."""
    run(read_case("beam2d", samples=4), tmp_path / "nodal", comm=MPI.COMM_SELF)
    folder = tmp_path / "structured"
    structure(tmp_path / "nodal", folder, order="random")
    assert check_dataset(folder) == []
    info = read_manifest(folder, "structured").structured
    assert info is not None
    assert info.stiffness is not None
    mesh = read_shard(folder / "shard-00000.h5", "structured")
    raw = RawMesh(mesh["mesh/coordinates"], mesh["mesh/cells"], "quad")
    found, expected = read_stiffness(folder), stiffness_of(raw, MATERIAL)
    assert np.array_equal(found.data, expected.data)
    assert np.array_equal(found.indices, expected.indices)
    path = folder / "stiffness.h5"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    assert check_dataset(folder) == [
        "stiffness.h5: damaged, its checksum does not match the manifest"
    ]
    structure(tmp_path / "nodal", folder, order="random")
    assert check_dataset(folder) == []
