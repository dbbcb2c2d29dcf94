"""The compliance carried to deformed states: exact at rest and under a rotation of the body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from shared_schema.materials import NeoHookean
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.descent import carried_compliance
from surrogate.mechanics.descent.carried_compliance import CarriedCompliance, exponential
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load, zoned

KINDS = (
    "quad",
    "triangle",
    "hexahedron",
    "tetra",
    "quad, mean dilation",
    "hexahedron, mean dilation",
    "quad, points between",
    "tetra, points between",
    "triangle, points between, mean dilation",
    "quad, two materials",
    "quad, rollers",
    "hexahedron, rollers",
)
STIFF = NeoHookean(young_modulus=5000, poisson_ratio=0.3)


def rolling(geometry: Geometry) -> Geometry:
    """Held across the planes at the origin only."""
    held = geometry.coordinates == 0
    return replace(geometry, single=held, clamped=held.all(axis=1))


def body_of(kind: str) -> Equilibrium:
    cell_type, *words = kind.split(", ")
    geometry = replace(box(cell_type), mean_dilation="mean dilation" in words)
    if "rollers" in words:
        geometry = rolling(geometry)
    if "two materials" in words:
        half = (geometry.coordinates[geometry.cells, 0].mean(axis=1) > 1).astype(int)
        return Equilibrium(replace(geometry, parts=half), (MATERIAL, STIFF))
    if "zones" in words:
        return Equilibrium(*zoned(cell_type))
    if "points between" in words:
        return Equilibrium(geometry, MATERIAL, on_points=True)
    return Equilibrium(geometry, MATERIAL)


def random_forces(body: Equilibrium) -> np.ndarray:
    return np.random.default_rng(0).normal(size=body.free.shape) * body.free


def turned(body: Equilibrium) -> np.ndarray:
    """Displacement of the body turned by one radian."""
    d = body.geometry.dimension
    rotation = Rotation.from_rotvec([0.0, 0.0, 1.0] if d == 2 else [0.6, 0.0, 0.8]).as_matrix()
    return body.geometry.coordinates @ (rotation[:d, :d] - np.eye(d)).T


@pytest.mark.parametrize("kind", KINDS)
def test_at_rest_it_is_the_linear_response(kind: str) -> None:
    body = body_of(kind)
    force = random_forces(body)
    found = CarriedCompliance(body).at(np.zeros_like(force))(force)
    expected = body.linear_response(force[None])[0]
    np.testing.assert_allclose(found, expected, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("kind", [kind for kind in KINDS if "rollers" not in kind])
def test_of_a_turned_body_it_is_the_inverse_of_the_tangent(kind: str) -> None:
    """The tangent of a body whose clamped nodes are turned with it."""
    body = body_of(kind)
    force, u = random_forces(body), turned(body)
    response = body.response_at(u)
    assert response is not None
    expected = response(force[None])[0]
    found = CarriedCompliance(body).at(u)(force)
    np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_symmetric_and_positive(kind: str) -> None:
    body = body_of(kind)
    u = 0.1 * np.sin(3 * body.geometry.coordinates) * body.free
    carried = CarriedCompliance(body).at(u)
    first, second = np.random.default_rng(1).normal(size=(2, *body.free.shape)) * body.free
    responses = carried(first), carried(second)
    assert np.vdot(second, responses[0]) == pytest.approx(np.vdot(first, responses[1]), rel=1e-9)
    assert np.vdot(first, responses[0]) > 0
    assert not responses[0][~body.free].any()


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_single_precision_of_a_large_body(monkeypatch: pytest.MonkeyPatch, scale: float) -> None:
    """Forces of any size lose no more than the digits of the numbers."""
    body = body_of("hexahedron")
    force, u = scale * random_forces(body), turned(body)
    expected = CarriedCompliance(body).at(u)(force)
    monkeypatch.setattr(carried_compliance, "LARGE", 0)
    found = CarriedCompliance(body).at(u)(force)
    assert 0 < np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()


@pytest.mark.parametrize("cell_type", ["quad", "hexahedron"])
def test_warped_response_is_nearer_than_the_linear_one(cell_type: str) -> None:
    """A slender beam bent by a quarter of its length; small loads do not change to first order."""
    geometry = box(cell_type)
    long = geometry.coordinates * ([5.0] + [1.0] * (geometry.dimension - 1))
    body = Equilibrium(replace(geometry, coordinates=long), MATERIAL)
    force = end_load(body.geometry, *(0.0, -1.0, 0.5)[: geometry.dimension])
    compliance = CarriedCompliance(body)
    linear = body.linear_response(force[None])[0]
    truth = correct(body, force, np.zeros_like(force)).displacement
    assert np.abs(truth).max() > 2
    warped = compliance.warped(linear)
    assert np.linalg.norm(warped - truth) < 0.5 * np.linalg.norm(linear - truth)
    small = 1e-4 * linear
    change = np.abs(compliance.warped(small) - small).max()
    assert change < 1e-3 * np.abs(small).max()


@pytest.mark.parametrize("d", [2, 3])
def test_exponential_of_rotations(d: int) -> None:
    random = np.random.default_rng(d).normal(size=(5, d, d))
    random *= np.reshape([0.0, 1e-9, 0.1, 1.0, 5.0], (5, 1, 1))
    turn = random - random.mT
    expected = np.stack([expm(each) for each in turn])
    np.testing.assert_allclose(exponential(turn), expected, atol=1e-14)
