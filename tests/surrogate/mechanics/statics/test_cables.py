"""Bodies that cables pull: series, directions, certificates and Newton's method agree."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from shared_schema.common.errors import InputError
from surrogate.mechanics.body.elements_of_case import with_elements
from surrogate.mechanics.descent.aim import Aim
from surrogate.mechanics.statics.body import Body
from surrogate.mechanics.statics.load import Load
from surrogate.mechanics.statics.prediction import Series
from tests.surrogate.mechanics.bodies import box

MATERIAL = {"model": "neo_hookean", "young_modulus": 500, "poisson_ratio": 0.4}
BODIES = [
    *(("quad", "linear"), ("hexahedron", "linear"), ("triangle", "quadratic")),
    *(("tetra", "incompressible"), ("quad", "incompressible")),
]


def pulled(cell_type: str, element: str) -> Body:
    """A box of 2 m with a cable along its upper side, and one from its end to a fixed point."""
    deeper = (0.4,) * (box(cell_type).dimension - 2)
    along = [[0.05, 0.9, *deeper], [1.05, 0.95, *deeper], [1.95, 0.9, *deeper]]
    anchored = [{"fixed": [3.0, 0.3, *deeper]}, [1.9, 0.6, *deeper]]
    actuators = {
        "along": {"cable": along, "tension": [0, 20]},
        "anchored": {"cable": anchored, "tension": [0, 20]},
    }
    case: dict[str, Any] = {"element": element, "material": MATERIAL, "actuators": actuators}
    return Body(with_elements(box(cell_type), case, "consistent"), case)


def load_of(body: Body, **amplitudes: float) -> Load:
    """A force at a corner of the end, and tensions in N."""
    place, force = ("2,0", "0,-1") if body.geometry.dimension == 2 else ("2,0,0", "0,-1,0")
    return Load.of(body.geometry, [f"{place}:{force}"], actuate=amplitudes)


@pytest.mark.parametrize(("cell_type", "element"), BODIES)
def test_all_ways_lead_to_one_equilibrium(cell_type: str, element: str) -> None:
    body = pulled(cell_type, element)
    load = load_of(body, along=12, anchored=4)
    predicted, _ = Series(body).respond(load)
    exact = body.correct(load, predicted).displacement
    size = np.abs(exact).max()
    without = body.correct(Load(load.dead), 0 * predicted).displacement
    assert np.abs(without - exact).max() > 0.1 * size
    assert np.abs(predicted - exact).max() < 5e-3 * size
    driven, _ = body.descend(load, predicted, Aim(1e-4))
    assert np.abs(driven - exact).max() < 1e-3 * size
    error = body.certify(load, predicted).error
    assert np.abs(error - (predicted - exact)).max() < 0.1 * np.abs(predicted - exact).max()


def test_tangent_of_cables_is_a_derivative() -> None:
    """K(u) δ is the change of r, by central differences; legs join cells that are apart."""
    body = pulled("hexahedron", "linear")
    load = load_of(body, along=12, anchored=4)
    under = body.under(load.following)
    rng = np.random.default_rng(0)
    u = 0.02 * rng.standard_normal((1, *under.free.shape)) * under.free
    change = rng.standard_normal(u.shape) * under.free
    f, h = load.dead[None], 1e-6
    ahead, back = under.out_of_balance(u + h * change, f), under.out_of_balance(u - h * change, f)
    inverse, _ = under.inverse_at(u)
    np.testing.assert_allclose(inverse((ahead - back) / (2 * h)), change, rtol=0, atol=1e-7)


def test_weights_are_derivatives_of_works() -> None:
    """The slopes of the works of cables on the terms, by central differences."""
    import torch

    from surrogate.mechanics.series.following_terms import FollowingTerms

    body = pulled("quad", "linear")
    following = load_of(body, along=12, anchored=4).following
    units, amplitudes = FollowingTerms.of(following)
    assert units is not None
    assert amplitudes is not None
    torch.manual_seed(0)
    terms = [
        0.1 * torch.randn(1, *body.geometry.coordinates.shape, dtype=torch.float64)
        for _ in range(3)
    ]
    works = units.works(amplitudes, terms)
    c, h = torch.tensor([[1.0, 0.7, 0.4]], dtype=torch.float64), 1e-6
    _, slopes = works.at(c)
    for k in range(3):
        step = torch.zeros_like(c)
        step[0, k] = h
        by_differences = (works.at(c + step)[0] - works.at(c - step)[0]) / (2 * h)
        torch.testing.assert_close(slopes[:, :, k], by_differences, rtol=1e-6, atol=1e-8)
    assert following is not None
    u = sum(float(w) * term for w, term in zip(c[0], terms, strict=True))
    assert isinstance(u, torch.Tensor)
    forces = following.forces(u.numpy())
    expected = [float((forces * term.numpy()).sum()) for term in terms]
    torch.testing.assert_close(works.at(c)[0][0].tolist(), expected, rtol=1e-10, atol=1e-10)


def test_wrong_actuators_are_refused() -> None:
    body = pulled("quad", "linear")
    with pytest.raises(InputError, match="the actuators are along, anchored"):
        load_of(body, below=1)
    with pytest.raises(InputError, match="expected a number from 0"):
        load_of(body, along=-1)
    with pytest.raises(InputError, match="expected a tension or a pressure, not the length"):
        Load.of(body.geometry, actuate=["along.length=1.5"])


def test_tensions_of_samples_are_told_from_their_forces() -> None:
    """In single precision, as a dataset has their sum; another force hides them."""
    body = pulled("triangle", "quadratic")
    geometry = body.geometry
    loads = [Load.of(geometry, actuate={"along": a, "anchored": b}) for a, b in ((3, 0), (12, 4))]
    forces = np.array([load.at_rest(geometry) for load in loads]).astype(np.float32)
    found = Load.of_samples(geometry, forces.astype(np.float64))
    assert found.following is not None
    np.testing.assert_allclose(found.following.amplitudes, [[3, 0], [12, 4]], atol=1e-5)
    assert not found.dead.any()
    forces[0, -1] += 1.0
    with pytest.raises(InputError, match="cannot be told"):
        Load.of_samples(geometry, forces.astype(np.float64))
