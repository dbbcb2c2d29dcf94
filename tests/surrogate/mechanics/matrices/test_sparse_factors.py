"""Sparse layouts against bands, with SuperLU and, where it is installed, with PARDISO."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.sparse import csc_array

from shared_schema.materials import NeoHookean
from surrogate.mechanics.body.elements_of_case import with_elements
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.certify.fast_estimate import FastEstimate
from surrogate.mechanics.descent import DrivenBody
from surrogate.mechanics.descent.carried_compliance import CarriedCompliance
from surrogate.mechanics.equilibrium.compliance import Compliance
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.matrices import layout
from surrogate.mechanics.matrices.factors import SparseFactor, general_lu
from surrogate.mechanics.statics.body import Body
from tests.surrogate.mechanics.bodies import box, end_load

MATERIAL = NeoHookean(young_modulus=500.0, poisson_ratio=0.4)
Array = NDArray[np.float64]


@pytest.fixture(params=["SuperLU", "PARDISO"])
def sparse(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Every stiffness is a sparse matrix, factorised by one of the two."""
    if request.param == "PARDISO":
        pytest.importorskip("pypardiso")
    else:
        monkeypatch.setattr(layout, "has_pardiso", lambda: False)
    monkeypatch.setattr(layout, "MOST", 0)
    return str(request.param)


@pytest.fixture
def banded() -> Equilibrium:
    return Equilibrium(box("tetra"), MATERIAL)


def forces(count: int) -> Array:
    random = np.random.default_rng(0)
    geometry = box("tetra")
    return random.normal(size=(count, *geometry.coordinates.shape)) * ~geometry.held


def test_responses_and_newton_steps(banded: Equilibrium, sparse: str) -> None:
    """The same as by a band, to rounding, at rest and bent; many right-hand sides at once."""
    body, f = Equilibrium(box("tetra"), MATERIAL), forces(20)
    assert body.layout.width is None
    expected = banded.linear_response(f)
    np.testing.assert_allclose(
        body.linear_response(f), expected, rtol=0, atol=1e-11 * np.abs(expected).max()
    )
    u = 0.2 * expected[:3] / np.abs(expected[:3]).max()
    steps, others = banded.newton_steps(u, f[:3]), body.newton_steps(u, f[:3])
    scale = np.abs(steps.steps).max()
    np.testing.assert_allclose(others.steps, steps.steps, rtol=0, atol=1e-9 * scale)
    assert np.array_equal(others.stable, steps.stable)


def test_a_matrix_that_is_not_definite(sparse: str) -> None:
    """The eigenvalues of K − c D, with the diagonal D of K, are negative if c is large."""
    body = Equilibrium(box("tetra"), MATERIAL)
    places = body.layout
    assert places.width is None
    k = places.assembled(body.solid.stiffness_at_rest())[0]
    assert places.factor(k) is not None
    assert places.factor(places.on_springs(k, -0.9 * places.diagonal(k))) is None
    assert places.factor(0 * k) is None


def test_a_body_with_pressures_of_its_own(sparse: str) -> None:
    """K has as many negative eigenvalues as there are pressures; more are not stable."""
    material = {"model": "neo_hookean", "young_modulus": 500.0, "poisson_ratio": 0.49}
    case = {"element": "incompressible", "material": material}
    body = Body(with_elements(box("tetra"), case, "consistent"), case).equilibrium
    f = body.forces_at_points(1e-9 * forces(1))
    left = body.out_of_balance(body.linear_response(f), f)
    assert np.abs(left).max() < 1e-3 * np.abs(f).max()  # of the pressures, after one step
    places, k = body.layout, body._tangent_of_solid(np.zeros_like(f))
    assert places.factor(k) is not None
    softer = places.on_springs(k, -0.9 * places.diagonal(k))
    assert places.factor(softer) is None


def test_loads_with_a_potential_need_one_factor(
    sparse: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A symmetric tangent keeps its factor; another one has one of its own, here of the same K."""
    body, random = Equilibrium(box("tetra"), MATERIAL), np.random.default_rng(0)
    places, f = body.layout, forces(1)[0].ravel()
    tangent = places.assembled(body.solid.stiffness_at_rest())[0]
    points = body.geometry.cells[-2:]
    blocks = 1e-4 * np.abs(tangent).max() * random.normal(size=(2, 12, 12))
    general: list[csc_array] = []

    def counted(matrix: csc_array, rows: NDArray[np.int64]) -> SparseFactor | None:
        general.append(matrix)
        return general_lu(matrix, rows)

    monkeypatch.setattr(layout, "general_lu", counted)
    for part, count in ((blocks + blocks.transpose(0, 2, 1), 0), (blocks, 1)):
        factor, stable = places.under_following(tangent, [(points, part)])
        k = places.matrix(places.with_blocks(tangent, points, part)).toarray()
        assert factor is not None
        assert stable
        assert len(general) == count
        right = f[places.dofs]
        np.testing.assert_allclose(k @ factor.solve(right), right, atol=1e-10 * np.abs(f).max())


def test_rows_are_exchanged_where_pivots_are_small() -> None:
    """A matrix whose first pivot is small has an accurate factor, a singular one has none."""
    matrix = np.array([[1e-14, 1.0, 0.0], [2.0, 1.0, 3.0], [0.0, 3.0, 1.0]])
    factor = general_lu(csc_array(matrix), np.arange(3))
    assert factor is not None
    assert factor.is_accurate()
    assert general_lu(csc_array(np.ones((3, 3))), np.arange(3)) is None


def test_single_precision_is_that_of_the_forces(sparse: str) -> None:
    body = Equilibrium(box("tetra"), MATERIAL)
    right = np.ones(len(body.layout.dofs), np.float32)
    assert body.undeformed.single.solve(right).dtype == np.float32


def test_corrections_estimates_and_directions(banded: Equilibrium, sparse: str) -> None:
    """What is built on the factor is the same as with a band."""
    geometry = box("tetra")
    body, f = Equilibrium(geometry, MATERIAL), end_load(geometry, 3.0, 2.0, 1.0)
    start = banded.linear_response(f[None])[0]
    expected = correct(banded, f, start).displacement
    size = np.abs(expected).max()
    np.testing.assert_allclose(
        correct(body, f, start).displacement, expected, rtol=0, atol=1e-10 * size
    )
    one, other = (FastEstimate(DrivenBody.of(e)) for e in (banded, body))
    np.testing.assert_allclose(
        other(f[None], start[None]), one(f[None], start[None]), rtol=0, atol=1e-9 * size
    )
    r = banded.out_of_balance(start[None], f[None])[0]
    one_p, other_p = (CarriedCompliance(e).at(start)(r) for e in (banded, body))
    np.testing.assert_allclose(other_p, one_p, rtol=0, atol=1e-9 * np.abs(one_p).max())


def test_compliance_of_a_large_body(sparse: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("surrogate.mechanics.equilibrium.compliance.DENSE", 0)
    large = Compliance(box("tetra"), MATERIAL)
    monkeypatch.undo()
    small = Compliance(box("tetra"), MATERIAL)
    force = torch.from_numpy(forces(3))
    expected = small(force).numpy()  # by a matrix in single precision
    np.testing.assert_allclose(
        large(force).numpy(), expected, rtol=0, atol=1e-6 * np.abs(expected).max()
    )
