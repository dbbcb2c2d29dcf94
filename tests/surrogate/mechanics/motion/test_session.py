"""Motion step by step: momenta, energies, order two, damping, contact, what is refused."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import surrogate
from shared_schema.common.errors import InputError
from shared_schema.motion import Damping, Scheme
from shared_schema.tools import Plane, Sphere
from surrogate.mechanics.certify.correction import iterated
from surrogate.mechanics.equilibrium.inertia import Inertia, Masses
from surrogate.mechanics.motion.moving_body import MovingBody
from surrogate.mechanics.motion.session import Session
from surrogate.mechanics.statics.body import Body
from surrogate.mechanics.statics.load import Load
from tests.surrogate.mechanics.bodies import box

EXACT = 1e-13
H = 0.01


def body_of(cell_type: str = "quad", element: str = "linear", free: bool = False) -> Body:
    """A box of 500 Pa and 1 kg/m³, which crosses itself as a wave in 0.1 s."""
    from surrogate.mechanics.body.elements_of_case import with_elements

    material = {"model": "neo_hookean", "young_modulus": 500, "poisson_ratio": 0.4, "density": 1.0}
    case = {"element": element, "material": material}
    geometry = with_elements(box(cell_type), case, "consistent")
    if free:
        geometry = replace(geometry, clamped=np.zeros_like(geometry.clamped))
    return Body(geometry, case)


def whirl(body: Body) -> np.ndarray:
    """Velocities in m/s of a body that turns, moves and stretches."""
    x = body.geometry.coordinates - body.geometry.coordinates.mean(axis=0)
    v = 0.3 * x + np.eye(x.shape[1])[0]
    v[:, 0] -= 2 * x[:, 1]
    v[:, 1] += 2 * x[:, 0]
    return v


def masses_of(body: Body, h: float = H, **of: Any) -> Masses:
    equilibrium, cells = body.equilibrium, len(body.geometry.cells)
    scheme = Scheme.generalised_alpha(h, 0.8)
    return Masses.of(equilibrium.solid, equilibrium.geometry, scheme, np.ones(cells), **of)


@pytest.mark.parametrize("cell_type", ["triangle", "hexahedron"])
def test_free_flight(cell_type: str) -> None:
    """Linear momentum stays, and the centre goes straight on, while the body whirls."""
    body = body_of(cell_type, free=True)
    session, masses = Session(body, tolerance=EXACT), masses_of(body).diagonal[:, None]
    v = whirl(body)
    session.begin(velocity=v)
    for _ in range(20):
        frame = session.step(H)
    before, after = ((masses * each).sum(axis=0) for each in (v, frame.velocity))
    np.testing.assert_allclose(after, before, atol=1e-9)
    centre = (masses * frame.displacement).sum(axis=0)
    np.testing.assert_allclose(centre, 0.2 * before, atol=1e-9)
    assert (
        np.linalg.norm(frame.displacement - 0.2 * v, axis=1).max() > 0.01
    )  # not rigid, nor linear


def test_fall() -> None:
    """u = g t² / 2, whatever the step."""
    body = body_of("tetra", free=True)
    session = Session(body)
    load = Load.of(body.geometry, None, body_force=[0, 0, -9.81])
    for h in (0.01, 0.03, 0.02):
        frame = session.step(h, load)
    np.testing.assert_allclose(frame.displacement[:, 2], -9.81 * 0.06**2 / 2, rtol=1e-6)
    assert frame.energies.strain < 1e-9
    assert abs(frame.energies.drift) < 1e-5 * frame.energies.work


@pytest.mark.parametrize("cell_type", ["quad", "tetra"])
def test_inverse_turns_with_the_body(cell_type: str) -> None:
    """Of a body that is turned, P is the turned inverse."""
    body = body_of(cell_type, free=True)
    driven = MovingBody(body.equilibrium, masses_of(body)).driven
    x = body.geometry.coordinates
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(x.shape[1],) * 2))[0]
    turn[0] *= np.linalg.det(turn)
    f = np.random.default_rng(1).normal(size=x.shape)
    expected = driven.equilibrium.linear_response((f @ turn)[None])[0] @ turn.T
    found = driven.compliance.at(x @ turn.T - x)(f)
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def swung(body: Body, h: float, **of: Any) -> np.ndarray:
    """Displacements under a load that begins and ends smoothly, every 12 ms."""
    session, every, found = Session(body, tolerance=1e-9, **of), round(0.012 / h), []
    load = Load.of(body.geometry, None, body_force=[0, -60])
    for n in range(1, 10 * every + 1):
        frame = session.step(h, load.part(np.sin(np.pi * n * h / 0.12) ** 2))
        found += [frame.displacement] if n % every == 0 else []
    return np.array(found)


@pytest.mark.parametrize("stiffness", [0.0, 0.02])
def test_order_two(stiffness: float) -> None:
    """The error falls by four where steps are halved, also with viscosity."""
    body, damping = body_of(), Damping(stiffness=stiffness, mass=0.5)
    found = [swung(body, h, damping=damping) for h in (0.004, 0.002, 0.001)]
    one, two = (np.linalg.norm(a - b) for a, b in pairwise(found))
    assert np.abs(found[-1]).max() > 0.1
    assert 3.2 < one / two < 5.2


def test_energy_stays() -> None:
    """With ρ∞ = 1 a large vibration keeps its energy to 0.5 %; with less it only loses some."""
    drifts = []
    for dissipation in (1.0, 0.5):
        session = Session(body_of(), dissipation=dissipation, tolerance=1e-8)
        session.begin("2,1:0,-8")
        for _ in range(100):
            frame = session.step(H)
        drifts.append(frame.energies.drift / session._first.strain)
    assert abs(drifts[0]) < 5e-3
    assert -0.5 < drifts[1] < -abs(drifts[0])


def test_damping_takes_the_energy_that_is_missing() -> None:
    """What damping takes is what the body loses; c makes an amplitude fall as exp(−c t / 2)."""
    session = Session(body_of(), dissipation=1.0, damping=Damping(stiffness=0.02), tolerance=1e-8)
    session.begin("2,1:0,-4")
    for _ in range(100):
        frame = session.step(H)
    before = session._first.strain
    assert frame.energies.dissipated > 0.2 * before
    assert abs(frame.energies.drift) < 5e-3 * before
    ends = []
    for c in (0.0, 0.6):
        session = Session(body_of(), dissipation=1.0, damping=Damping(mass=c), tolerance=1e-8)
        session.begin("2,1:0,-0.01")
        for _ in range(100):
            frame = session.step(H)
        ends.append(frame.energies.kinetic + frame.energies.strain)
    assert ends[1] / ends[0] == pytest.approx(np.exp(-0.6), rel=0.05)  # it swings


@pytest.mark.parametrize(
    ("cell_type", "element", "stiffness"),
    [
        ("quad", "linear", 0.0),
        ("tetra", "linear", 0.03),
        ("triangle", "quadratic", 0.0),
        ("hexahedron", "incompressible", 0.0),
        ("triangle", "incompressible", 0.0),
    ],
)
def test_step_is_that_of_newton(cell_type: str, element: str, stiffness: float) -> None:
    """Directions end where Newton's method does; the estimate covers what they leave."""
    body, h = body_of(cell_type, element), 0.03
    force = np.zeros(body.geometry.coordinates.shape)
    force[body.geometry.coordinates[:, 0] == 2, 1] = -1
    damping = Damping(stiffness=stiffness)
    ends = {}
    for tolerance in (5e-3, 1e-10):
        session = Session(body, tolerance=tolerance, damping=damping)
        session.begin(velocity=np.where(body.geometry.held, 0, whirl(body)))
        for _ in range(3):
            frame = session.step(h, Load(force))
        ends[tolerance] = frame.displacement
    first = session._now
    assert first is not None
    frame = session.step(h, Load(force))
    step = Inertia.of(first.masses, first.u, first.v, first.a, first.left)
    moving = body.equilibrium.moving(step)
    f = body.equilibrium.forces_at_points(force[None])
    exact = iterated(moving, f, first.u[None], "last state", 1e-9).displacement
    size = np.abs(frame.displacement).max()
    assert np.abs(frame.displacement - exact[: len(force)]).max() < 1e-7 * size
    assert np.abs(ends[5e-3] - ends[1e-10]).max() < 0.015 * size  # three steps of 0.5 %


def test_held_places_move() -> None:
    """A grip takes its place along, and its work is the energy of the body."""
    session = Session(body_of(), tolerance=1e-9, dissipation=1.0)
    for n in range(1, 41):
        frame = session.step(H, held={"2,1": (0.0, -0.5 * (1 - np.cos(np.pi * n / 40)))})
    node = len(frame.displacement) - 1
    np.testing.assert_allclose(frame.displacement[node], [0, -1.0], atol=1e-12)
    assert frame.reactions[node, 1] > 0  # it brakes what is under way
    energies = frame.energies
    assert energies.kinetic + energies.strain == pytest.approx(energies.work, rel=0.01)
    for _ in range(20):
        frame = session.step(H)
    assert abs(frame.energies.drift) < 0.01 * energies.work  # let go, it moves on its own


def test_a_tool_that_touches_a_body_at_rest_moves_nothing() -> None:
    body = body_of()
    top = float(body.geometry.coordinates[:, 1].max())
    session = Session(body)
    frame = session.step(H, tool=Sphere((1.0, top + 0.3), 0.3))
    assert np.abs(frame.displacement).max() < 1e-15
    np.testing.assert_allclose(frame.reaction, 0.0, atol=1e-12)


def test_rebound() -> None:
    """A drop that hits a plane gains the momentum that the plane has given, and leaves it."""
    body = body_of("quad", free=True)
    session, masses = Session(body, tolerance=1e-8), masses_of(body).diagonal[:, None]
    down = np.zeros(body.geometry.coordinates.shape)
    down[:, 1] = -2.0
    session.begin(velocity=down)
    floor, impulse = Plane((0.0, -0.05), (0.0, 1.0)), np.zeros(2)
    for _ in range(60):
        frame = session.step(H, tool=floor)
        impulse += H * frame.reaction
        assert (body.geometry.coordinates + frame.displacement)[:, 1].min() > -0.05 - 2e-3
    assert not frame.force.any()
    gained = (masses * (frame.velocity - down)).sum(axis=0)
    np.testing.assert_allclose(gained, impulse, atol=1e-5)
    assert gained[1] > 1.3 * 2.0 * masses.sum()  # some of it is vibration


def test_certificate_and_estimate_of_a_step() -> None:
    session = Session(body_of())
    for _ in range(5):
        frame = session.step(0.04, "2,1:0,-8", certify=True)
    assert frame.certificate is not None
    assert frame.certificate.settled
    assert frame.error <= 5e-3 * np.abs(frame.displacement).max()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"seconds": 0.0}, "seconds 0.0: expected a positive number"),
        ({"seconds": -1.0}, "seconds -1.0"),
        ({"seconds": H, "held": {"0,0": (0.1, 0.0)}}, "the node is clamped"),
        ({"seconds": H, "actuation": {"left": 1.0}}, "no actuators"),
    ],
)
def test_wrong_steps(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Session(body_of()).step(**wrong)


def test_wrong_sessions() -> None:
    model = surrogate.load("beam2d_any")
    with pytest.raises(InputError, match="density"):
        Session(model)
    with pytest.raises(InputError, match="dissipation"):
        Session(model, density=1.0, dissipation=2.0)
    session = Session(model, density=1.0)
    session.step(H, tool=Sphere((2.0, 1.5), 0.3))
    with pytest.raises(InputError, match="jumps through the body"):
        session.step(H, tool=Sphere((2.0, -0.5), 0.3))
