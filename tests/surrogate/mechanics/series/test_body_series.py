"""Load series of any material, element and load, against the equilibria of the finite elements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from shared_schema.common.bodies.cells import outward_facets
from shared_schema.common.bodies.following_loads import PressedSurface
from shared_schema.materials import (
    ArrudaBoyce,
    FibreReinforced,
    Gent,
    Guccione,
    HolzapfelGasserOgden,
    Materials,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    StVenantKirchhoff,
    Yeoh,
)
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.series.body_series import BodySeries
from surrogate.mechanics.series.following_terms import FollowingTerms
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load

MATERIALS: dict[str, Materials] = {
    "neo_hookean": MATERIAL,
    "nearly incompressible": NeoHookean(young_modulus=500, poisson_ratio=0.499),
    "st_venant_kirchhoff": StVenantKirchhoff(young_modulus=500, poisson_ratio=0.4),
    "mooney_rivlin": MooneyRivlin(c10=60, c01=25, bulk_modulus=3000),
    "yeoh": Yeoh(c10=80, c20=30, c30=5, bulk_modulus=3000),
    "gent": Gent(shear_modulus=170, limit=8, bulk_modulus=3000),
    "arruda_boyce": ArrudaBoyce(shear_modulus=160, limit_stretch=2, bulk_modulus=3000),
    "ogden": Ogden(mu=(150.0, -10.0), alpha=(2.0, -2.0), bulk_modulus=3000),
    "guccione": Guccione(
        stiffness=40, b_f=8, b_t=3, b_fs=5, bulk_modulus=3000, fibres=((0.8, 0.6),)
    ),
    "holzapfel_gasser_ogden": HolzapfelGasserOgden(
        c10=70,
        k1=150,
        k2=3,
        kappa=0.1,
        bulk_modulus=3000,
        compression=True,
        fibres=((0.8, 0.6), (0.6, -0.8)),
    ),
    "two": (MATERIAL, Yeoh(c10=40, c20=10, c30=2, bulk_modulus=1000)),
}
ELEMENTS = {
    "linear": ("triangle", "quad", "tetra", "hexahedron"),
    "quadratic": ("triangle", "tetra"),
    "incompressible": ("triangle", "quad", "tetra", "hexahedron"),
}
ORDER = 5
LOAD, PRESSURE = (0.3, -2.0, 0.8), 3.0  # N at a corner, Pa on the upper side: up to 0.4 of 2 m


def body(element: str, cell_type: str, material: str) -> Equilibrium:
    geometry = box(cell_type)
    is_two, whole = material == "two", element == "incompressible"
    parts = (geometry.coordinates[geometry.cells, 0].mean(axis=1) > 1).astype(int)
    geometry = replace(
        geometry,
        mean_dilation=whole,
        parts=parts if is_two else None,
        fibres=directions(geometry, MATERIALS[material]),
    )
    if element == "quadratic" or (whole and cell_type in ("triangle", "tetra")):
        geometry = replace(geometry, has_points_between=True)
        return Equilibrium(geometry, MATERIALS[material], on_points=True)
    return Equilibrium(geometry, MATERIALS[material])


def directions(geometry: Geometry, material: Materials) -> np.ndarray | None:
    """Directions of the families in all cells, turned out of the plane in space."""
    if not isinstance(material, FibreReinforced):
        return None
    assert isinstance(material.fibres, tuple)
    given = np.array(material.fibres)
    if geometry.dimension == 3:
        given = np.pad(given, ((0, 0), (0, 1)), constant_values=0.5)
    given /= np.linalg.norm(given, axis=1, keepdims=True)
    return np.repeat(given[None], len(geometry.cells), axis=0)


def upper_side(cell_type: str, equilibrium: Equilibrium) -> FollowingLoads:
    """A pressure on the side y = 1."""
    geometry = box(cell_type)
    facets = outward_facets(geometry.coordinates, geometry.cells, cell_type)
    upper = facets[np.isclose(geometry.coordinates[facets][:, :, 1], 1).all(axis=1)]
    points = getattr(equilibrium, "points", None)
    surface = upper if points is None else points.facets(upper)
    return FollowingLoads.on(
        geometry.coordinates, (PressedSurface(surface),), np.array([[PRESSURE]]), points
    )


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize(
    ("element", "cell_type"),
    [(element, cell_type) for element, some in ELEMENTS.items() for cell_type in some],
)
def test_five_terms_are_the_equilibrium(element: str, cell_type: str, material: str) -> None:
    """Under a force, a pressure that follows the surface, and both: within 0.5 %."""
    equilibrium = body(element, cell_type, material)
    series, d = BodySeries(equilibrium, ORDER), equilibrium.geometry.dimension
    nodes = equilibrium.nodes
    load = end_load(box(cell_type), *LOAD[:d])
    push = upper_side(cell_type, equilibrium)
    for force, pressure in ((load, None), (0 * load, push), (load, push)):
        at_points = equilibrium.forces_at_points(force[None])
        found, last = series.predicted(at_points, pressure)
        under = equilibrium if pressure is None else equilibrium.under(pressure)
        expected = correct(under, force, found[0, :nodes]).displacement
        size = np.linalg.norm(expected, axis=1).max()
        assert np.linalg.norm(found[0, :nodes] - expected, axis=1).max() < 0.005 * size
        assert last[0] < 0.1 * size
        linear = equilibrium.linear_response(under.at_rest(at_points))[0, :nodes]
        assert np.linalg.norm(linear - expected, axis=1).max() > 0.001 * size


@pytest.mark.parametrize("element", ELEMENTS)
def test_terms_are_derivatives(element: str) -> None:
    """The remainder of n terms, all weights 1, is of order n + 1 in the load."""
    equilibrium = body(element, "quad" if element != "quadratic" else "triangle", "yeoh")
    nodes, order = equilibrium.nodes, 3
    cell_type = "quad" if element != "quadratic" else "triangle"
    load, push = end_load(box(cell_type), 0.3, -2.0), upper_side(cell_type, equilibrium)
    errors = []
    for t in (0.5, 0.25):
        scaled = equilibrium.forces_at_points(t * load[None])
        pressure = push.scaled(t)
        found = sum_of_terms(equilibrium, order, scaled, pressure)
        exact = correct(equilibrium.under(pressure), t * load, found[0, :nodes], 1e-11)
        errors.append(np.abs(found[0, :nodes] - exact.displacement).max())
    assert 13 < errors[0] / errors[1] < 20  # 2⁴


def sum_of_terms(
    equilibrium: Equilibrium, order: int, forces: np.ndarray, following: FollowingLoads
) -> np.ndarray:
    """Σ uₖ, with weights of 1."""
    series, pressed = BodySeries(equilibrium, order), FollowingTerms.of(following)
    terms, _ = series.terms(series.first(torch.from_numpy(forces), *pressed), *pressed)
    return torch.stack(terms).sum(0).numpy()


def test_compiled_loops_are_the_same() -> None:
    """Of bodies without a dilation of their own, under dead forces."""
    for cell_type in ELEMENTS["linear"]:
        for name, material in MATERIALS.items():
            if isinstance(material, FibreReinforced):
                continue
            equilibrium = body("linear", cell_type, name)
            load = end_load(box(cell_type), *LOAD[: equilibrium.geometry.dimension])[None]
            series = BodySeries(equilibrium, ORDER)
            compiled, last = series.predicted(load)
            series.compiled = False
            general, other = series.predicted(load)
            size = np.abs(general).max()
            np.testing.assert_allclose(compiled, general, atol=1e-6 * size)
            np.testing.assert_allclose(last, other, atol=1e-6 * size)


def test_no_load_and_a_small_one() -> None:
    equilibrium = body("linear", "quad", "yeoh")
    series = BodySeries(equilibrium, ORDER)
    load = end_load(box("quad"), 0.3, -2.0)[None]
    assert not series.predicted(0 * load)[0].any()
    small, _ = series.predicted(1e-9 * load)
    np.testing.assert_allclose(small, 1e-9 * equilibrium.linear_response(load), rtol=1e-6)
