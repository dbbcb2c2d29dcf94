"""Motion in modes beside that of the whole body: paths, frequencies, damping, what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from shared_schema.common.errors import InputError
from shared_schema.motion import Damping
from surrogate.mechanics.motion.reduced_motion import ReducedMotion
from surrogate.mechanics.motion.session import Session
from surrogate.mechanics.statics.body import Body
from tests.surrogate.mechanics.motion.test_session import body_of
from tests.surrogate.mechanics.statics.test_cables import pulled

H = 0.02


def paths(body: Body, load: str, let_go: bool, **keys: Any) -> tuple[np.ndarray, np.ndarray]:
    """Displacements in modes, and of the whole body, (40, n_nodes, d): let go, or pulled."""
    reduced, session = (
        ReducedMotion(body, [load], step=H, modes=40, motions=12, **keys),
        Session(body, tolerance=1e-6, **keys),
    )
    if let_go:
        reduced.begin([1.0])
        session.begin(load)
    found, exact = [], []
    for n in range(1, 41):
        factor = 0.0 if let_go else float(np.sin(8 * n * H))
        found.append(reduced.step([factor]))
        place, _, force = load.partition(":")
        now = f"{place}:{','.join(repr(factor * float(f)) for f in force.split(','))}"
        exact.append(session.step(H, now).displacement)
    assert reduced.time == pytest.approx(session.time)
    return np.array(found), np.array(exact)


def at_corner(body: Body, force: str) -> str:
    """A force at the upper corner of the free end, as text."""
    place = body.geometry.coordinates.max(axis=0)
    return ",".join(f"{value:g}" for value in place) + f":{force}"


@pytest.mark.parametrize("let_go", [True, False])
@pytest.mark.parametrize("damping", [Damping(), Damping(mass=0.5, stiffness=0.01)])
@pytest.mark.parametrize("element", ["linear", "incompressible"])
def test_the_path_is_that_of_the_whole_body(element: str, damping: Damping, let_go: bool) -> None:
    """Within 2 % of the largest displacement, which is more than a tenth of the body."""
    body = body_of("quad", element)
    found, exact = paths(body, at_corner(body, "0,-8"), let_go, damping=damping)
    assert np.abs(exact).max() > 0.1 * body.geometry.coordinates.max()
    assert np.abs(found - exact).max() < 0.02 * np.abs(exact).max()


def test_actuators_in_motion() -> None:
    """Cables that pull at once: the path of the whole body within 2 %."""
    body, tensions = pulled("quad", "linear"), {"along": 6.0, "anchored": 2.0}
    motion = ReducedMotion(body, step=H, motions=18, density=1.0)
    session = Session(body, density=1.0)
    both = [
        (motion.step(actuation=tensions), session.step(H, actuation=tensions).displacement)
        for _ in range(25)
    ]
    found, exact = map(np.array, zip(*both, strict=True))
    assert np.abs(found - exact).max() < 0.02 * np.abs(exact).max()


def test_wrong_input_is_refused() -> None:
    body = body_of()
    load = at_corner(body, "0,-1")
    with pytest.raises(InputError, match="expected some, of a body without actuators"):
        ReducedMotion(body)
    with pytest.raises(InputError, match="step -1"):
        ReducedMotion(body, [load], step=-1)
    motion = ReducedMotion(body, [load], motions=2, step=H)
    with pytest.raises(InputError, match="expected 1 finite numbers"):
        motion.step([1.0, 2.0])
    with pytest.raises(InputError, match="the case has no actuators"):
        motion.step(actuation={"left": 1.0})
