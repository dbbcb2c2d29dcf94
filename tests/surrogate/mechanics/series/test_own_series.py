"""Series inside networks: of the body's own elements, materials, fibres and pressures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from shared_schema.common.bodies.following_loads import PressedSurface
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.kinds import run_config
from surrogate.mechanics.body.elements_of_case import with_elements
from surrogate.mechanics.series.body_series import BodySeries
from surrogate.mechanics.series.series_response import SeriesResponse
from surrogate.mechanics.solids.mixed_elements import TaylorHoodSolid
from surrogate.mechanics.solids.solid import Solid
from tests.surrogate.mechanics.bodies import box, end_load
from tests.surrogate.mechanics.series.test_body_series import (
    MATERIALS,
    body,
    directions,
    upper_side,
)
from tests.surrogate.unet_configs import unet_config

ORDER = 4


def response_of(element: str, cell_type: str, material: str, pressed: bool) -> SeriesResponse:
    """The response of a box, with a pressure on its upper side."""
    geometry = box(cell_type)
    between = element == "quadratic" or (element == "incompressible" and cell_type == "triangle")
    (push,) = upper_side(cell_type, body("linear", cell_type, material)).units
    assert isinstance(push, PressedSurface)
    geometry = replace(
        geometry,
        mean_dilation=element == "incompressible",
        has_points_between=between,
        fibres=directions(geometry, MATERIALS[material]),
        pressed=push.facets if pressed else None,
    )
    return SeriesResponse(geometry, MATERIALS[material], False, ORDER)


@pytest.mark.parametrize(
    ("element", "cell_type", "material"),
    [
        ("quadratic", "triangle", "yeoh"),
        ("incompressible", "triangle", "yeoh"),
        ("incompressible", "quad", "neo_hookean"),
        ("linear", "quad", "guccione"),
        ("quadratic", "tetra", "mooney_rivlin"),
    ],
)
def test_pressures_are_told_and_follow(element: str, cell_type: str, material: str) -> None:
    """Forces on the grid, a pressure among them: those of `BodySeries` under both."""
    response = response_of(element, cell_type, material, pressed=True)
    equilibrium, geometry = response.equilibrium, box(cell_type)
    d, nodes = geometry.dimension, len(geometry.coordinates)
    load = end_load(geometry, *(0.3, -2.0, 0.8)[:d])
    push = upper_side(cell_type, equilibrium)
    expected, _ = BodySeries(equilibrium, ORDER).predicted(
        equilibrium.forces_at_points(load[None]), push
    )
    total = load + push.load[0, :nodes] * geometry.free
    force = torch.from_numpy(geometry.grid.forces_to_grid(total))[None].float()
    found, _ = response(force)
    on_grid = geometry.grid.to_grid(expected[:, :nodes])
    size = np.abs(expected).max()
    np.testing.assert_allclose(found, on_grid, atol=1e-5 * size)
    dead, _ = BodySeries(equilibrium, ORDER).predicted(equilibrium.forces_at_points(total[None]))
    assert np.abs(dead - expected).max() > 1e-3 * size


def test_forces_on_half_of_a_surface_keep_their_direction() -> None:
    """No pressure can be told from them."""
    response = response_of("linear", "quad", "neo_hookean", pressed=True)
    assert response.pressed is not None
    nodal = torch.from_numpy(np.random.default_rng(0).normal(size=(3, 2, response.nodes)))
    dead, pressures = response.pressed.told_apart(nodal)
    assert pressures is not None
    assert not pressures.any()
    torch.testing.assert_close(dead, nodal)


@pytest.mark.parametrize("element", ["quadratic", "incompressible"])
def test_models_have_the_elements_of_the_case(dataset: Dataset, element: str) -> None:
    """Taylor and Hood's too; a network of before keeps linear ones."""
    case = {"element": element}
    geometry = with_elements(box("triangle"), case, None)
    model = run_config({"name": "a", "case": "bar", "model": "series"})
    found = model.build_for(geometry, dataset.info, MATERIALS["yeoh"], case).linear
    assert isinstance(found, SeriesResponse)
    kind = TaylorHoodSolid if element == "incompressible" else Solid
    assert type(found.series.solid) is kind
    assert found.series.solid.nodes > found.nodes
    network = {"inputs": ["force", "linear_gradient", "last_gradient"], "skip": "series"}
    of_before = unet_config(case="bar", network={"levels": 2, "channels": 4, **network})
    older = of_before.build_for(geometry, dataset.info, MATERIALS["yeoh"], case, before=True).linear
    assert isinstance(older, SeriesResponse)
    assert older.series.solid.nodes == found.nodes


@pytest.mark.parametrize(
    ("element", "material", "pressed"),
    [
        ("linear", "neo_hookean", False),
        ("linear", "yeoh", False),
        ("linear", "guccione", False),
        ("incompressible", "holzapfel_gasser_ogden", True),
        ("quadratic", "yeoh", True),
    ],
)
def test_derivatives_by_forces(element: str, material: str, pressed: bool) -> None:
    """Of a tensor that requires gradients, against central differences."""
    cell_type = "quad" if element == "linear" else "triangle"
    response, geometry = response_of(element, cell_type, material, pressed), box(cell_type)
    push = upper_side(cell_type, body("linear", cell_type, material)).load[0]
    load = end_load(geometry, 0.3, -2.0) + (pressed * push * geometry.free)
    force = torch.from_numpy(geometry.grid.forces_to_grid(load))[None]
    draw = np.random.default_rng(0)
    change = torch.from_numpy(geometry.grid.forces_to_grid(end_load(geometry, 0.5, 0.7)))
    by = torch.from_numpy(draw.normal(size=(2, response.nodes)))

    def value(force: torch.Tensor) -> torch.Tensor:
        first, pressures = response.first(force)
        u = first + response.beyond_first(first, pressures)[0]
        return (u[:, :, : response.nodes] * by).sum()

    force.requires_grad_()
    (gradient,) = torch.autograd.grad(value(force), force)
    with torch.no_grad():
        step = 1e-3
        central = (value(force + step * change) - value(force - step * change)) / (2 * step)
    torch.testing.assert_close((gradient[0] * change).sum(), central, rtol=2e-3, atol=1e-4)
