"""Directions end at the equilibrium of the finite elements, of any material and element."""

from __future__ import annotations

from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from shared_schema.common.errors import InputError
from shared_schema.materials import Gent, MooneyRivlin, ShippedMaterial, Yeoh
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.descent import Aim, Descent, DrivenBody, descend, driven_body
from surrogate.mechanics.descent.driven_body import longest
from surrogate.mechanics.descent.trust import MARGIN
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load
from tests.surrogate.mechanics.descent.test_carried_compliance import KINDS, body_of
from tests.surrogate.mechanics.equilibrium.test_following_loads import pressed

YEOH = Yeoh(c10=80, c20=30, c30=5, bulk_modulus=3000)
MATERIALS: list[ShippedMaterial] = [
    Yeoh(c10=80, c20=-3, c30=0.4, bulk_modulus=800),
    Gent(shear_modulus=170, limit=8, bulk_modulus=800),
    MooneyRivlin(c10=60, c01=25, bulk_modulus=800),
]


def bent(body: Equilibrium) -> np.ndarray:
    """Forces that move the last node by a third of the body's length."""
    nodes = replace(body.geometry, coordinates=body.geometry.coordinates[: body.nodes])
    force = end_load(nodes, *(3.0, -9.0, 5.0)[: body.geometry.dimension])
    return force * body.free[: body.nodes]


def driven(
    body: Equilibrium,
    force: np.ndarray,
    predicted: np.ndarray,
    aim: Aim,
    last_term: float = np.inf,
) -> tuple[np.ndarray, Descent]:
    return descend(DrivenBody.of(body), force, predicted, aim, last_term)


def relative_error(found: np.ndarray, truth: np.ndarray) -> float:
    return longest(found - truth) / longest(truth)


@pytest.mark.parametrize("kind", KINDS)
def test_every_element(kind: str) -> None:
    body = body_of(kind)
    force = bent(body)
    truth = correct(body, force, np.zeros_like(force)).displacement
    assert longest(truth) > 0.1
    for tolerance in (1e-2, 1e-8):
        found, descent = driven(body, force, np.zeros_like(force), Aim(tolerance))
        assert descent.reached
        assert descent.directions < 60
        assert descent.allowed == pytest.approx(tolerance * longest(found), rel=tolerance)
        assert descent.estimate <= MARGIN * descent.allowed
        assert relative_error(found, truth) < tolerance


@pytest.mark.parametrize("cell_type", ["quad", "tetra"])
@pytest.mark.parametrize("material", MATERIALS, ids=lambda material: material.model)
def test_every_material(material: ShippedMaterial, cell_type: str) -> None:
    body = Equilibrium(box(cell_type), material)
    force = bent(body)
    truth = correct(body, force, np.zeros_like(force)).displacement
    found, descent = driven(body, force, np.zeros_like(force), Aim(1e-8))
    assert descent.reached
    assert relative_error(found, truth) < 1e-8


@pytest.mark.parametrize("kind", ["quad", "hexahedron", "quad, mean dilation"])
def test_pressures_that_follow_the_surface(kind: str) -> None:
    """Beside a force; the tangent is not symmetric."""
    body = body_of(kind)
    body = body.under(pressed(body.geometry, 9.0))
    force = 0.2 * bent(body)
    truth = correct(body, force, np.zeros_like(force)).displacement
    found, descent = driven(body, force, np.zeros_like(force), Aim(1e-8))
    assert descent.reached
    assert relative_error(found, truth) < 1e-8


def test_a_good_prediction_takes_one_direction() -> None:
    """The first direction estimates its error; smaller tolerances take more directions."""
    body = body_of("quad")
    force = bent(body)
    truth = correct(body, force, np.zeros_like(force)).displacement
    predicted = 1.001 * truth
    found, descent = driven(body, force, predicted, Aim(1e-2))
    assert (descent.directions, descent.reached, descent.kept) == (1, True, True)
    assert relative_error(found, truth) < 0.3 * relative_error(predicted, truth)
    assert descent.estimate == pytest.approx(1e-3 * longest(truth), rel=0.3)
    numbers = []
    for tolerance in (1e-3, 1e-5, 1e-7):
        found, descent = driven(body, force, predicted, Aim(tolerance))
        assert relative_error(found, truth) < tolerance
        numbers.append(descent.directions)
    assert numbers == sorted(set(numbers))
    in_metres = driven(body, force, predicted, Aim(1e-2 * longest(predicted), in_metres=True))[1]
    assert in_metres.directions == 1


@pytest.mark.parametrize("kind", ["quad", "hexahedron", "quad, mean dilation"])
def test_a_small_last_term_needs_no_direction(kind: str) -> None:
    """Of a stable state under dead forces."""
    body = body_of(kind)
    force = bent(body)
    predicted = 1.0001 * correct(body, force, np.zeros_like(force)).displacement
    allowed = 1e-2 * longest(predicted)
    found, descent = driven(body, force, predicted, Aim(1e-2), 0.6 * allowed)
    assert descent == Descent(0, 0.6 * allowed, allowed, True)
    assert descent.kept
    np.testing.assert_array_equal(found, predicted)
    assert driven(body, force, predicted, Aim(1e-2), allowed)[1].directions == 1
    assert driven(body, force, predicted, Aim(budget=1e-12), 0.0)[1].directions == 1
    pushed = body.under(pressed(body.geometry, 1.0))
    assert driven(pushed, force, predicted, Aim(1e-2), 0.0)[1].directions > 0
    turned_over = body.geometry.coordinates * -2.0 * (np.arange(body.geometry.dimension) == 0)
    assert driven(body, force, turned_over, Aim(1e-2), 0.0)[1].directions > 0


@pytest.mark.parametrize("wrong", ["no numbers", "turned over", "far away", "of another load"])
def test_wrong_predictions(wrong: str) -> None:
    """The directions begin at the linear response with finite rotations instead."""
    body = body_of("hexahedron")
    force = bent(body)
    truth = correct(body, force, np.zeros_like(force)).displacement
    predicted = {
        "no numbers": truth * np.nan,
        "turned over": body.geometry.coordinates * [-2.0, 0.0, 0.0],
        "far away": 1e200 * truth,
        "of another load": -truth,
    }[wrong]
    found, descent = driven(body, force, predicted, Aim(1e-6))
    assert descent.reached
    assert relative_error(found, truth) < 1e-6


@pytest.mark.parametrize("cell_type", ["quad", "hexahedron"])
def test_a_straight_column_above_its_buckling_load(cell_type: str) -> None:
    """It is in equilibrium, and not stable: no tolerance is reached. Below that load it is.

    The last term of a series would be small.
    """
    geometry = box(cell_type)
    long = geometry.coordinates * ([10.0] + [1.0] * (geometry.dimension - 1))
    body = Equilibrium(replace(geometry, coordinates=long), MATERIAL)
    end = long[:, 0] == 20.0
    for total, stable in ((0.1, True), (20.0, False)):  # N; Euler's is 0.3 N, the mesh is stiffer
        force = np.zeros_like(long)
        force[end, 0] = -total / end.sum()
        straight = body.linear_response(force[None])[0]
        found, descent = driven(body, force, straight, Aim(1e-3), 0.0)
        assert (descent.reached, descent.stable) == (stable, stable)
        assert (body.response_at(found) is not None) == stable
    assert "is not stable" in descent.refusal(body.units)


def test_a_column_just_above_its_buckling_load() -> None:
    """3 % above the load at which the tangent of the straight column is singular, and 3 % below.

    The softest mode at rest is not quite that of the loaded column, whose θ is then near zero.
    """
    geometry = box("quad")
    long = geometry.coordinates * (10.0, 1.0)
    body = Equilibrium(replace(geometry, coordinates=long), MATERIAL)
    end = long[:, 0] == 20.0

    def straight(total: float, aim: Aim) -> tuple[np.ndarray, Descent]:
        force = np.zeros_like(long)
        force[end, 0] = -total / end.sum()
        return driven(body, force, body.linear_response(force[None])[0], aim, 0.0)

    low, high = 0.1, 20.0
    while high - low > 0.01 * low:
        middle = (low + high) / 2
        is_stable = body.response_at(straight(middle, Aim(1e-6))[0]) is not None
        low, high = (middle, high) if is_stable else (low, middle)
    assert straight(0.97 * low, Aim(1e-3))[1].reached
    above = straight(1.03 * high, Aim(1e-3))[1]
    assert (above.reached, above.stable) == (False, False)


def test_soft_modes() -> None:
    """Those of the dense stiffness, whose stresses soften them as its differences say."""
    body = body_of("quad")
    soft_body = DrivenBody.of(body)
    modes = soft_body.modes
    size, dofs = body.free.size, body.layout.dofs
    unit = np.zeros((len(dofs), size))
    unit[np.arange(len(dofs)), dofs] = 1.0
    inverse = body.linear_response(unit.reshape(-1, *body.free.shape)).reshape(-1, size)[:, dofs]
    expected = np.sort(1 / np.linalg.eigvalsh(inverse))[: len(modes)]
    found = 1 / np.square(modes).sum((1, 2))
    np.testing.assert_allclose(found[:3], expected[:3], rtol=1e-3)
    forces = [(stiffness_product(soft_body, mode) * modes).sum((1, 2)) for mode in modes]
    np.testing.assert_allclose(forces, np.eye(len(modes)), atol=1e-4)
    rest = np.zeros(body.free.shape)
    state = soft_body.state(rest, rest)
    assert state is not None
    assert soft_body.softest(state, rest) == pytest.approx(1.0)
    assert soft_body.softened(state) == pytest.approx(1.0)


@pytest.mark.parametrize("cell_type", ["quad", "triangle", "hexahedron"])
@pytest.mark.parametrize("material", [MATERIAL, YEOH])
def test_stresses_soften_columns_of_incompressible_elements(
    cell_type: str, material: ShippedMaterial, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compressed by 1.5 %: as products with the tangent say, which are differences of r."""
    geometry = replace(box(cell_type), mean_dilation=True)
    long = geometry.coordinates * ([4.0] + [1.0] * (geometry.dimension - 1))
    geometry = replace(geometry, coordinates=long, has_points_between=cell_type == "triangle")
    on_points = cell_type == "triangle"
    equilibrium = Equilibrium(geometry, material, on_points)
    body = DrivenBody.of(equilibrium)
    along = equilibrium.geometry.coordinates[:, :1]
    u = np.pad(-0.015 * along, ((0, 0), (0, geometry.dimension - 1))) * equilibrium.free
    state = body.state(u, 0 * u)
    assert state is not None
    found = body.softened(state)
    monkeypatch.setattr(driven_body, "SOFT", np.inf)
    assert found == pytest.approx(body.softest(state, 0 * u), rel=0.05)
    assert found < -5


def stiffness_product(body: DrivenBody, mode: np.ndarray) -> np.ndarray:
    """K(0) v by a difference of r."""
    beside = body.state(1e-6 * mode, 0 * mode)
    assert beside is not None
    return beside.r / 1e-6


def test_no_load() -> None:
    body = body_of("quad")
    nothing = np.zeros_like(body.geometry.coordinates)
    found, descent = driven(body, nothing, nothing, Aim(1e-3))
    assert not found.any()
    assert (descent.directions, descent.estimate, descent.reached) == (1, 0.0, True)


def test_the_budget_is_looked_at_before_every_step() -> None:
    """A clock that goes on by a second whenever it is read."""
    body, taken = body_of("quad"), []
    force = bent(body)
    predicted = 1.05 * correct(body, force, np.zeros_like(force)).displacement
    driven_body = DrivenBody.of(body)
    for budget in (0.5, 1.5, 2.5, 3.5):
        clock = map(float, count()).__next__
        _, descent = descend(driven_body, force, predicted, Aim(1e-9, budget), clock=clock)
        assert descent.reached is False
        taken.append(descent.directions)
    assert taken == [1, 2, 3, 4]
    clock = map(float, count()).__next__
    _, descent = descend(driven_body, force, predicted, Aim(budget=3.5), clock=clock)
    assert (descent.directions, descent.reached, descent.allowed) == (4, None, 0.0)


def test_a_tolerance_below_rounding_errors_is_not_reached() -> None:
    """The best displacement is given: it is in equilibrium."""
    body = body_of("hexahedron")
    force = bent(body)
    truth = correct(body, force, np.zeros_like(force)).displacement
    found, descent = driven(body, force, np.zeros_like(force), Aim(1e-30))
    assert descent.reached is False
    assert relative_error(found, truth) < 1e-8


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, "1", True])
def test_wrong_aims(value: object) -> None:
    for name in ("tolerance", "budget"):
        with pytest.raises(InputError, match=rf"{name}.*{value}.*expected a (positive )?number"):
            Aim(**{name: value})  # type: ignore[arg-type]
    with pytest.raises(InputError, match="expected a tolerance or a budget"):
        Aim()
