"""Bodies and problems that several tests share."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator

from tools.open_mpi import OF_A_RUN, SETTINGS

os.environ.setdefault("OMP_NUM_THREADS", "1")
for name in list(os.environ):  # of an MPI that the process above has begun, as pytest-xdist's does
    if name.startswith(OF_A_RUN) and name not in SETTINGS:
        del os.environ[name]

import numpy as np
import pytest
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.cases.body import Body, make_body
from datagen.cases.case import Case, read_case
from datagen.mesh.distributed_mesh import Mesh, make_mesh
from datagen.mesh.geometries import Box
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.settings import SolverSettings
from shared_schema.materials import NeoHookean, Volumetric

ProblemMaker = Callable[..., EquilibriumProblem]
NodeFinder = Callable[..., int]


@pytest.fixture(autouse=True, scope="session")
def _loaded_modules_are_no_garbage() -> None:
    gc.collect()
    gc.freeze()  # so that the collection after each test looks at new objects only


@pytest.fixture(autouse=True)
def _collect_garbage() -> Iterator[None]:
    yield
    gc.collect()  # frees PETSc objects in reference cycles


@pytest.fixture(scope="session")
def beam_case() -> Case:
    return read_case("beam2d")


@pytest.fixture(scope="session")
def beam(beam_case: Case) -> Body:
    return make_body(beam_case, MPI.COMM_SELF)


@pytest.fixture
def make_problem() -> ProblemMaker:
    """Make a function that builds a problem on a box clamped at x = 0."""

    def make(
        elements: tuple[int, ...] = (3, 2),
        upper: tuple[float, ...] = (2.0, 1.0),
        poisson_ratio: float = 0.4,
        volumetric: Volumetric = "paper",
        distortion: float = 0.0,
    ) -> EquilibriumProblem:
        lower = (0.0,) * len(upper)
        mesh = make_mesh(Box(lower=lower, upper=upper, elements=elements), MPI.COMM_SELF)
        if distortion:
            mesh = distorted(mesh, np.asarray(upper), distortion)
        material = NeoHookean(young_modulus=500, poisson_ratio=poisson_ratio, volumetric=volumetric)
        clamped = np.isclose(mesh.coordinates[:, 0], 0.0)
        return EquilibriumProblem(mesh, material, clamped, SolverSettings())

    return make


def distorted(mesh: Mesh, size: NDArray[np.float64], amount: float) -> Mesh:
    """Move the inner nodes at random by up to `amount` m."""
    inner = np.all((mesh.coordinates > 1e-9) & (mesh.coordinates < size - 1e-9), axis=1)
    moves = np.random.default_rng(3).uniform(-amount, amount, mesh.coordinates.shape)
    coordinates = np.where(inner[:, None], mesh.coordinates + moves, mesh.coordinates)
    numbers = np.asarray(mesh.domain.geometry.input_global_indices)
    mesh.domain.geometry.x[:, : len(size)] = coordinates[numbers]
    return Mesh(coordinates, mesh.cells, mesh.cell_type, domain=mesh.domain)


@pytest.fixture
def node_at() -> NodeFinder:
    """Make a function that finds the number of the node at a point."""

    def find(coordinates: NDArray[np.float64], *point: float) -> int:
        distance = np.linalg.norm(coordinates - np.asarray(point), axis=1)
        assert distance.min() < 1e-9
        return int(distance.argmin())

    return find
