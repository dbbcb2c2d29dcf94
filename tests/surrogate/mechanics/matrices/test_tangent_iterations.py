"""Conjugate gradients in place of a tangent's factors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import surrogate
from surrogate.certify.correction import correct
from surrogate.certify.full_certificate import certify
from surrogate.data.geometry import Geometry
from surrogate.descent import DrivenBody
from surrogate.descent.carried_compliance import CarriedCompliance
from surrogate.mechanics.matrices import sparse_matrix, stiffness_layout, tangent_iterations
from surrogate.mechanics.matrices.tangent_iterations import Iterations
from surrogate.mechanics.out_of_balance import Equilibrium
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load

Array = NDArray[np.float64]
SIZE = 200


class Inverse:
    """Factors of a matrix, in the simplest way."""

    def __init__(self, matrix: Array) -> None:
        self.matrix, self.asked = matrix, 0

    def solve(self, right: Array) -> Array:
        self.asked += 1
        return np.asarray(np.linalg.solve(self.matrix, right))


def matrix_of(eigenvalues: Array) -> tuple[Array, Array]:
    """A matrix K, and a P whose products K P have these eigenvalues."""
    random = np.random.default_rng(2)
    root = np.tril(random.normal(size=(SIZE, SIZE))) / np.sqrt(SIZE) + 2 * np.eye(SIZE)
    q, _ = np.linalg.qr(random.normal(size=(SIZE, SIZE)))
    k = root @ (q * eigenvalues) @ q.T @ root.T
    return (k + k.T) / 2, np.linalg.inv(root @ root.T)


def iterations(eigenvalues: Array) -> tuple[Iterations, Array, Inverse]:
    k, p = matrix_of(eigenvalues)
    factor = Inverse(k)
    return Iterations(k.__matmul__, p.__matmul__, SIZE, lambda: factor), k, factor


def test_solutions() -> None:
    """For one right-hand side and several, to the accuracy, without the factor; NaN of NaN."""
    found, k, factor = iterations(np.linspace(0.5, 2, SIZE))
    right = np.random.default_rng(0).normal(size=(SIZE, 3))
    expected = np.linalg.solve(k, right)
    close = 1e-5 * np.abs(expected).max()
    np.testing.assert_allclose(found.solve(right), expected, rtol=0, atol=close)
    np.testing.assert_allclose(found.solve(right[:, 0]), expected[:, 0], rtol=0, atol=close)
    assert not found.solve(np.zeros(SIZE)).any()
    assert np.isnan(found.solve(np.full(SIZE, np.nan))).all()
    assert found.is_definite()
    assert factor.asked == 0


@pytest.mark.parametrize("least", [-1.0, -1e-3, 0.0])
def test_one_negative_eigenvalue_is_found(least: float) -> None:
    """Of two hundred; the factor solves then."""
    found, k, factor = iterations(np.r_[least, np.linspace(0.5, 2, SIZE - 1)])
    assert not found.is_definite()
    if least < 0:
        right = np.random.default_rng(1).normal(size=SIZE)
        np.testing.assert_allclose(k @ found.solve(right), right, rtol=0, atol=1e-8)
        assert factor.asked == 1


def test_too_many_iterations(monkeypatch: pytest.MonkeyPatch) -> None:
    """The factor solves; without one, the solution is no number."""
    monkeypatch.setattr(tangent_iterations, "MOST", 3)
    found, k, factor = iterations(np.geomspace(1e-3, 1, SIZE))
    assert not found.is_definite()
    right = np.ones(SIZE)
    np.testing.assert_allclose(k @ found.solve(right), right, rtol=0, atol=1e-8)
    assert factor.asked == 1
    neither: Iterations = Iterations(k.__matmul__, lambda r: 0.5 * r, SIZE, lambda: None)
    assert np.isnan(neither.solve(right)).all()


@pytest.fixture
def superlu(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every stiffness is a sparse matrix, factorised by SuperLU."""
    monkeypatch.setattr(sparse_matrix, "has_pardiso", lambda: False)
    monkeypatch.setattr(tangent_iterations, "has_pardiso", lambda: False)
    monkeypatch.setattr(stiffness_layout, "MOST", 0)


def both(geometry: Geometry) -> tuple[Equilibrium, Equilibrium]:
    """The body by factors, and by iterations."""
    body = Equilibrium(geometry, MATERIAL)
    return body, body.iterating(CarriedCompliance(body).at)


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    """Number of solutions by iterations so far."""
    count, solve = [0], tangent_iterations.conjugate_gradients

    def counting(*words: object) -> Array | None:
        found = solve(*words)  # type: ignore[arg-type]
        count[0] += found is not None
        return found

    monkeypatch.setattr(tangent_iterations, "conjugate_gradients", counting)
    return lambda: count[0]


@pytest.mark.parametrize("cell_type", ["quad", "triangle", "hexahedron", "tetra"])
def test_steps_certificates_and_corrections(
    cell_type: str, superlu: None, counted: Callable[[], int]
) -> None:
    """The same as by factors: steps to the accuracy, corrections to their own tolerance."""
    geometry = box(cell_type)
    f = end_load(geometry, *(3.0, 2.0, 1.0)[: geometry.dimension])
    factorised, iterated = both(geometry)
    truth = correct(factorised, f, 0 * f).displacement
    size = np.abs(truth).max()
    u = 0.97 * truth
    one, other = (body.newton_steps(u[None], f[None]) for body in (factorised, iterated))
    close = 1e-5 * np.abs(one.steps).max()
    np.testing.assert_allclose(other.steps, one.steps, rtol=0, atol=close)
    np.testing.assert_allclose(other.simplified, one.simplified, rtol=0, atol=close)
    assert other.stable.all()
    error = certify(iterated, f, u).error
    np.testing.assert_allclose(error, certify(factorised, f, u).error, rtol=0, atol=close)
    before = counted()
    assert before > 4
    for start in (u, 0 * u):
        found = correct(iterated, f, start).displacement
        np.testing.assert_allclose(found, truth, rtol=0, atol=1e-8 * size)
    assert counted() > before


def test_an_unstable_state(superlu: None) -> None:
    """A slender column under three times its critical load: not stable by iterations either."""
    plain = box("quad")
    slender = plain.coordinates * [5.0, 0.5]
    geometry = type(plain)(**{**vars(plain), "coordinates": slender})
    factorised, iterated = both(geometry)
    end = np.zeros_like(slender)
    end[-4:, 0] = np.array([-1, -2, -2, -1]) / 6
    for load, is_stable in ((0.2, True), (6.0, False)):
        u = factorised.linear_response(load * end[None])
        assert (factorised.unstable_mode(u) is None) == is_stable
        assert (iterated.unstable_mode(u) is None) == is_stable
        assert bool(iterated.newton_steps(u, load * end[None]).stable[0]) == is_stable


def test_certificates_and_corrections_of_a_run(
    request: pytest.FixtureRequest,
) -> None:
    """Those of a network of the package, whose body counts as a large one: as with its band."""
    band = surrogate.load("beam2d_any")
    force = np.zeros((2, *band.geometry.coordinates.shape))
    force[:, -1, 1] = -0.5, 1.0
    predicted = band.predict(force)
    error, truth = band.certify(force, predicted).error, band.correct(force[0]).displacement
    request.getfixturevalue("superlu")
    count = request.getfixturevalue("counted")
    large = surrogate.load("beam2d_any")
    close = 1e-5 * np.abs(error).max()
    np.testing.assert_allclose(large.certify(force, predicted).error, error, rtol=0, atol=close)
    assert count() > 0
    close = 1e-8 * np.abs(truth).max()
    np.testing.assert_allclose(large.correct(force[0]).displacement, truth, rtol=0, atol=close)


def test_large_bodies_iterate_without_pardiso(
    superlu: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The body of directions, whose certificates these are; with PARDISO, and by a band, not."""
    large = Equilibrium(box("quad"), MATERIAL)
    assert DrivenBody.of(large).equilibrium.carried is not None
    assert large.carried is None
    monkeypatch.setattr(tangent_iterations, "has_pardiso", lambda: True)
    assert DrivenBody.of(large).equilibrium.carried is None
    monkeypatch.undo()
    assert DrivenBody.of(Equilibrium(box("quad"), MATERIAL)).equilibrium.carried is None
