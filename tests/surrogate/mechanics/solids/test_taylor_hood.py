"""Triangles and tetrahedra of Taylor and Hood: displacements alone, and sparse tangents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from shared_schema.materials import MooneyRivlin, NeoHookean, ShippedMaterial
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.certify.full_certificate import certify
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.solids.deformation import energy_density
from surrogate.mechanics.solids.mixed_elements import TaylorHoodSolid
from tests.surrogate.mechanics.bodies import box, end_load

CELLS = ("triangle", "tetra")
SILICONE = NeoHookean(young_modulus=500, poisson_ratio=0.49)
RUBBER = NeoHookean(young_modulus=500, poisson_ratio=0.4999)
STEP = 1e-6  # m, of central differences


def body_of(
    cell_type: str, material: ShippedMaterial = SILICONE, length: float = 2.0, free: bool = False
) -> Equilibrium:
    geometry = replace(box(cell_type), mean_dilation=True)
    coordinates = geometry.coordinates.copy()
    coordinates[:, 0] *= length / 2.0
    clamped = geometry.clamped & (not free)
    return Equilibrium(
        replace(geometry, coordinates=coordinates, clamped=clamped), material, on_points=True
    )


def waves(body: Equilibrium, size: float) -> np.ndarray:
    return size * np.sin(3 * body.geometry.coordinates)[None] * body.free


def differences(body: Equilibrium, u: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """K(u) times directions, by central differences of the forces."""
    forces = [
        body.out_of_balance(u + sign * STEP * directions, np.zeros_like(directions))
        for sign in (1, -1)
    ]
    return np.asarray(forces[0] - forces[1]) / (2 * STEP)


@pytest.mark.parametrize("cell_type", CELLS)
def test_homogeneous_deformation(cell_type: str) -> None:
    """E = W(F) V, and the dilation is det F."""
    body = body_of(cell_type, free=True)
    d = body.geometry.dimension
    change = 0.1 * np.random.default_rng(0).normal(size=(d, d))
    u = (body.geometry.coordinates @ change.T)[None]
    expected = energy_density(torch.from_numpy(np.eye(d) + change), SILICONE) * 2.0
    assert body.potential(u, 0 * u)[0] == pytest.approx(expected.item(), rel=1e-12)
    assert isinstance(body.solid, TaylorHoodSolid)
    dilation = body.solid.dilation(torch.from_numpy(u)).numpy()
    assert dilation == pytest.approx(np.linalg.det(np.eye(d) + change), rel=1e-12)


@pytest.mark.parametrize(
    "material", [SILICONE, MooneyRivlin(model="mooney_rivlin", c10=70, c01=20, bulk_modulus=9000)]
)
@pytest.mark.parametrize("cell_type", CELLS)
def test_derivatives(cell_type: str, material: ShippedMaterial) -> None:
    """Forces are the slope of the energy; the sparse tangent answers their changes."""
    body = body_of(cell_type, material)
    u = waves(body, 0.0002)
    direction = np.random.default_rng(0).normal(size=u.shape) * body.free
    nothing = np.zeros_like(u)
    energies = [body.potential(u + sign * STEP * direction, nothing)[0] for sign in (1, -1)]
    work = float((body.out_of_balance(u, nothing) * direction).sum())
    assert work == pytest.approx((energies[0] - energies[1]) / (2 * STEP), rel=1e-6)
    step, stable = body.newton_step(u, differences(body, u, direction))
    assert stable
    np.testing.assert_allclose(-step, direction, atol=1e-6)


def test_stability_is_that_of_the_dense_tangent() -> None:
    """The eigenvalues of K by differences, of states from soft to unstable."""
    body = body_of("triangle")
    dofs = body.layout.dofs
    directions = np.zeros((len(dofs), body.free.size))
    directions[np.arange(len(dofs)), dofs] = 1.0
    directions = directions.reshape(-1, *body.free.shape)
    verdicts = []
    for size in (0.0, 0.005, 0.01, 0.02, 0.04):
        u = waves(body, size)
        tangent = differences(body, u, directions).reshape(len(dofs), -1)[:, dofs]
        lowest = np.linalg.eigvalsh((tangent + tangent.T) / 2)[0]
        _, stable = body.newton_step(u, np.ones_like(u))
        assert stable == (lowest > 0), (size, lowest)
        mode = body.unstable_mode(u)
        assert (mode is None) == stable
        if mode is not None:
            assert (mode * differences(body, u, mode)).sum() < 0
        verdicts.append(stable)
    assert True in verdicts
    assert False in verdicts


def test_inverted_states_are_told() -> None:
    """Turned-over cells, and not a number; a prediction of them has no certificate."""
    body = body_of("triangle")
    u = np.zeros((2, *body.free.shape))
    u[0] = body.geometry.coordinates * [-3.0, 0.0]
    u[1, -1] = np.nan
    assert (body.inverted(u) > 0).all()
    assert body.potential(u, np.zeros_like(u))[0] == np.inf
    found = certify(body, np.zeros((body.nodes, 2)), u[0, : body.nodes])
    assert found.inverted > 0
    assert not found.settled


def test_a_straight_column_is_left() -> None:
    """Above Euler's load, 1.6 N per m at ν = 0.3, the straight state is unstable: it buckles."""
    material = NeoHookean(young_modulus=500, poisson_ratio=0.3)
    body = body_of("triangle", material, length=8.0)
    x = body.geometry.coordinates[: body.nodes]
    force = np.zeros_like(x)
    force[x[:, 0] == 8.0, 0] = -2.5 / 4
    found = correct(body, force, np.zeros_like(x)).displacement
    assert np.abs(found[:, 1]).max() > 0.5


def test_two_materials_and_small_units() -> None:
    """A body of 2 µm and 500 kPa has the same strains."""
    geometry: Geometry = replace(box("triangle"), mean_dilation=True)
    parts = (geometry.coordinates[geometry.cells][..., 1].mean(axis=1) > 0.5).astype(np.int64)
    force = end_load(geometry, 0.0, 1.0)
    found = []
    for length, modulus in ((1.0, 1.0), (1e-6, 1e3)):
        layers = tuple(
            NeoHookean(young_modulus=e * modulus, poisson_ratio=ratio)
            for e, ratio in ((500, 0.4999), (100, 0.3))
        )
        scaled = replace(geometry, coordinates=length * geometry.coordinates, parts=parts)
        body = Equilibrium(scaled, layers, on_points=True)
        loaded = force * modulus * length
        found.append(correct(body, loaded, np.zeros_like(force)).displacement / length)
    assert np.abs(found[0]).max() > 0.03
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-8)


@pytest.mark.parametrize("cell_type", ["triangle", "tetra"])
def test_mass_matrix_by_products_alone(cell_type: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where there is no factor, Chebyshev's iteration solves as it does, with gradients."""
    small = body_of(cell_type).solid
    monkeypatch.setattr("surrogate.mechanics.solids.mixed_elements.DENSE", 0)
    solid, draw = body_of(cell_type).solid, torch.Generator().manual_seed(0)
    shape = len(solid.cells), 3, solid.volumes.shape[1]
    values = torch.randn(shape, generator=draw, dtype=torch.float64, requires_grad=True)
    found, expected = solid.projected(values), solid.projected(values.detach())
    torch.testing.assert_close(found.detach(), expected, rtol=0, atol=1e-9)
    torch.testing.assert_close(small.projected(values.detach()), expected, rtol=0, atol=1e-12)
    weights = solid.volumes[:, None] * values.detach()
    (gradient,) = torch.autograd.grad((weights * found).sum(), values)  # Π is symmetric
    expected = solid.volumes[:, None] * expected
    torch.testing.assert_close(gradient, expected, rtol=0, atol=1e-9)
