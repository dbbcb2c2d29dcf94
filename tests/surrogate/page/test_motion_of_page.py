"""The page's time steps, run by node, are those of `surrogate.Session`; what a page has of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import surrogate
from shared_schema.common.errors import InputError
from shared_schema.motion import Damping
from surrogate.mechanics.body.elements_of_case import with_elements
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.motion.session import TOLERANCE, Session
from surrogate.mechanics.statics.body import Body
from surrogate.mechanics.statics.load import Load
from surrogate.page.page_motion import motion_data
from tests.surrogate.mechanics.bodies import box, end_load
from tests.surrogate.mechanics.series.test_body_series import upper_side
from tests.surrogate.page.actuated import chambered
from tests.surrogate.page.page_in_node import PageInNode

Array = NDArray[np.float64]
MATERIAL = {"model": "neo_hookean", "young_modulus": 500, "poisson_ratio": 0.4, "density": 1.0}
EXACT = 1e-9  # tolerance of a session
PULLED, SWINGING = 10, 50  # time steps


@pytest.fixture(scope="module")
def ask(tmp_path_factory: pytest.TempPathFactory) -> PageInNode:
    """Ask the page's mechanics, bundled once."""
    return PageInNode(tmp_path_factory.mktemp("page"))


def beam(density: float = 0.1) -> Body:
    """The beam of `beam2d_any`, 4 m × 1 m of 500 Pa, with a density in kg/m³."""
    body = surrogate.load("beam2d_any").body
    material = body.case["material"] | {"density": density}
    return Body(body.geometry, {**body.case, "material": material})


def pull_and_let_go() -> list[float]:
    """Factors of a load that grows in equal steps, and then is gone."""
    return [*np.linspace(0, 1, PULLED + 1)[1:], *np.zeros(SWINGING)]


def frames(
    body: Body, force: Array, following: FollowingLoads | None = None, **settings: Any
) -> Array:
    """Displacements in m at all nodes after each step of a session that begins at rest."""
    session = Session(body, **{"tolerance": EXACT} | settings)
    session.begin(acting=Load(0 * force))
    step = motion_data(body)[0]["motion"]["step"]
    found = []
    for factor in pull_and_let_go():
        load = Load(factor * force)
        if following is not None and factor > 0:
            load = Load(load.dead, replace(following, amplitudes=factor * following.amplitudes))
        found.append(session.step(step, load).displacement)
    return np.array(found)


def of_page(
    ask: PageInNode,
    body: Body,
    force: Array,
    following: FollowingLoads | None = None,
    *,
    damping: float = 0.0,
    stiffness: float = 1.0,
) -> tuple[Array, Array]:
    """The same on the page, of a body that is stiffer by a factor, and estimated errors in m."""
    at_points = body.equilibrium.forces_at_points(force[None])[0] / stiffness
    pressures: Sequence[float] = ()
    if following is not None:
        pressures = (following.amplitudes[0] / stiffness).tolist()
    asked = {
        "kind": "motion",
        "force": at_points,
        "pressures": pressures,
        "u": 0 * at_points,
        "factors": pull_and_let_go(),
        "damping": damping,
        "stiffness": stiffness,
    }
    units = () if following is None else following.units
    (found,) = ask(body.equilibrium, [asked], units, moving=body)
    nodes = len(body.geometry.coordinates)
    both = np.array(found).reshape(len(found), 2, -1, body.geometry.dimension)[:, :, :nodes]
    return both[:, 0], both[:, 1]


def test_beam_is_pulled_and_swings(ask: PageInNode) -> None:
    """To 0.01 % of an exact session, and 0.5 % of one with its own tolerance."""
    body = beam()
    force = np.zeros_like(body.geometry.coordinates)
    force[body.geometry.tip] = [0.3, -1.5]
    (found, _), expected = of_page(ask, body, force), frames(body, force)
    size = np.abs(expected).max()
    assert size > 0.25  # m
    assert np.abs(found - expected).max() < 1e-4 * size
    assert np.abs(found - frames(body, force, tolerance=TOLERANCE)).max() < 5e-3 * size
    tip = found[PULLED:, body.geometry.tip, 1]
    assert tip.min() < -0.25
    assert tip.max() > 0.2  # beyond the place of rest


def test_estimated_errors_of_steps(ask: PageInNode) -> None:
    """Of first steps, from the same state as those of an exact session."""
    body = beam()
    force = np.zeros_like(body.geometry.coordinates)
    for size in (5, 10, 20):
        force[body.geometry.tip] = [0.3 * size, -1.5 * size]
        found, errors = of_page(ask, body, force)
        error = np.abs(found[0] - frames(body, force)[0]).max()
        assert np.abs(errors[0]).max() == pytest.approx(error, rel=0.2)


@pytest.mark.parametrize(
    ("element", "cell_type"), [("incompressible", "tetra"), ("quadratic", "triangle")]
)
def test_pressure_damping_and_a_stiffer_body(ask: PageInNode, element: str, cell_type: str) -> None:
    """Of twice the modulus, under a force and a pressure, with points between the nodes."""

    def made(modulus: float) -> Body:
        case = {"element": element, "material": MATERIAL | {"young_modulus": modulus}}
        return Body(with_elements(box(cell_type), case, "consistent"), case)

    body, stiffer = made(500), made(1000)
    force = end_load(box(cell_type), *(3.0, -9.0, 2.0)[: body.geometry.dimension])
    push = upper_side(cell_type, body.equilibrium)
    step = motion_data(body)[0]["motion"]["step"]
    assert step == motion_data(stiffer)[0]["motion"]["step"]
    expected = frames(stiffer, force, push, damping=Damping(mass=2.0))
    found, _ = of_page(ask, body, force, push, damping=2.0, stiffness=2.0)
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()


def test_frequency_and_time_steps() -> None:
    """A slender beam vibrates as Euler and Bernoulli's; a fiftieth of the period is a step."""
    for density in (0.1, 1e-4):
        material = MATERIAL | {"poisson_ratio": 0.0, "density": density}
        case = {"element": "quadratic", "material": material}
        geometry = with_elements(beam().geometry, case, "consistent")
        thin = replace(geometry, coordinates=geometry.coordinates * [1, 0.2])  # 4 m × 0.2 m
        motion = motion_data(Body(thin, case))[0]["motion"]
        euler = 1.875104**2 * np.sqrt(500 * 0.2**2 / 12 / density) / 4**2
        assert motion["frequency"] == pytest.approx(euler, rel=0.01)
        assert motion["step"] == pytest.approx(min(1 / 60, 2 * np.pi / motion["frequency"] / 50))


def test_settings_of_the_case() -> None:
    """Dissipation, damping and mass are those of `time`; without a density nothing moves."""
    body = beam()
    time = {"dissipation": 0.0, "damping": {"mass": 0.5}, "mass": "lumped"}
    of_case, masses = motion_data(Body(body.geometry, {**body.case, "time": time}))
    motion = of_case["motion"]
    assert (motion["fresh"], motion["former"], motion["carried"]) == (2, -1, 0)
    assert 2 * motion["damping"] * motion["frequency"] == pytest.approx(0.5)
    assert np.count_nonzero(masses["motion/mass/weights"]) == len(body.geometry.coordinates)
    assert masses["motion/mass/weights"].sum() == pytest.approx(0.4)  # kg
    still = surrogate.load("beam2d_any").body
    assert motion_data(still) == ({}, {})
    assert motion_data(still, 0.1)[0] == motion_data(body)[0]


def test_densities_that_are_refused() -> None:
    with pytest.raises(InputError, match="density -1"):
        motion_data(beam(), -1.0)
    with pytest.raises(InputError, match="density: expected none"):
        motion_data(chambered(), 1.0)
    assert motion_data(chambered()) == ({}, {})
