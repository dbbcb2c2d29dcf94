"""Smooth patches of traction, and the quadrature on facets, against integrals in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from datagen.cases.case import read_case
from datagen.cases.placed_body import placed
from shared_schema.common.bodies.distributed_loads import facet_points
from shared_schema.loads.distributed_forces import surface_of
from tests.datagen.loads.places import family, place

TRIANGLE = np.array([[[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [0.0, 1.0, 1.0]]])
SQUARE = np.array([[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 0.0, 3.0], [0.0, 0.0, 3.0]]])
EDGE = np.array([[[1.0, 1.0], [1.0, 3.0]]])


@pytest.mark.parametrize(
    ("corners", "area", "square"),
    [
        (EDGE, 2.0, 26 / 3),  # ∫ y² from 1 to 3
        (TRIANGLE, 1.0, 2 / 3),  # ∫ x² = 2³ · 1 / 12
        (SQUARE, 6.0, 8.0),  # ∫ x² = 3 · 2³ / 3
    ],
    ids=["edge", "triangle", "quadrilateral"],
)
def test_quadrature_is_exact_for_squares(corners: np.ndarray, area: float, square: float) -> None:
    positions, areas, values = facet_points(corners)
    assert areas.sum() == pytest.approx(area, rel=1e-14)
    coordinate = positions[..., 1 if corners is EDGE else 0]
    assert (areas * coordinate**2).sum() == pytest.approx(square, rel=1e-14)
    np.testing.assert_allclose(values.sum(axis=1), 1, rtol=1e-14)
    shares = areas[0] @ values
    np.testing.assert_allclose(shares, area / corners.shape[1], rtol=1e-14)


@pytest.mark.parametrize(
    ("region", "elements", "integral"),
    [
        ({"y": 1, "x": "> 0"}, (160, 4), 16 / 15 * 0.4),  # ∫ (1 − s²/R²)² ds = 16 R / 15
        ({"z": 1, "x": "> 0"}, (80, 20, 2), np.pi * 0.4**2 / 3),  # over a disc: π R² / 3
    ],
    ids=["edge", "face"],
)
def test_resultant(region: dict[str, object], elements: tuple[int, ...], integral: float) -> None:
    """Patches whose disc lies inside the region: the sum of the forces is traction times integral.

    With 20 elements to the diameter or more the quadrature is right to 1e-3.
    """
    loadable, radius = place(region, elements), 0.4
    patch = family("traction_patch", range=[-3, 3], radius=radius)
    x = loadable.coordinates
    seen = 0
    for number in range(60):
        load = patch.draw(number, 0, loadable)
        middle = (x[load.nodes].min(axis=0) + x[load.nodes].max(axis=0)) / 2
        inside = 0.5 < middle[0] < 3.5 and (len(middle) == 2 or 0.45 < middle[1] < 0.55)
        if not inside:
            continue
        seen += 1
        ratio = load.forces / load.forces[0]
        np.testing.assert_allclose(ratio, ratio[:, :1].repeat(len(middle), axis=1), rtol=1e-9)
        traction = load.forces.sum(axis=0) / integral
        assert np.abs(traction).max() <= 3 * (1 + 2e-3)
        weight = np.linalg.norm(load.forces.sum(axis=0)) / integral
        again = np.random.default_rng([0, number])
        again.integers(len(loadable))
        drawn = again.uniform(-3, 3, size=len(middle))
        assert weight == pytest.approx(np.linalg.norm(drawn), rel=2e-3)
    assert seen >= 2


def test_forces_are_in_the_region_and_within_reach() -> None:
    loadable = place({"y": 1, "x": "> 0"}, (16, 4))
    patch = family("traction_patch", range=[-1, 1], radius=0.6)
    patch.check(loadable)
    places = set()
    for number in range(100):
        load = patch.draw(number, 0, loadable)
        assert set(load.nodes) <= set(loadable.nodes)
        assert len(load.nodes) <= patch.loads_per_sample(loadable)
        x = loadable.coordinates[load.nodes, 0]
        assert np.ptp(x) <= 2 * (0.6 + 0.25)
        places.add(x.mean().round(2))
    assert len(places) > 10


def test_a_radius_that_reaches_nothing_is_refused() -> None:
    loadable = place({"y": 1, "x": "> 0"}, (16, 4))
    with pytest.raises(ValueError, match=r"key 'radius' = 0.01: a patch about the node at"):
        family("traction_patch", range=[-1, 1], radius=0.01).check(loadable)
    family("traction_patch", range=[-1, 1], radius=0.2).check(loadable)


def test_several_patches_of_random_radius() -> None:
    """The forces are the sum of single patches, drawn in turn: centre, traction, radius."""
    loadable = place({"y": 1, "x": "> 0"}, (32, 4))
    several = family("traction_patch", range=[-2, 2], radius=[0.3, 0.7], count=[1, 3])
    several.check(loadable)
    counts = set()
    for number in range(20):
        random = np.random.default_rng([7, number])
        patches = random.integers(1, 4)
        counts.add(int(patches))
        expected = np.zeros(loadable.coordinates.shape)
        for _ in range(patches):
            centre = loadable.coordinates[loadable.nodes[random.integers(len(loadable))]]
            traction, radius = random.uniform(-2, 2, size=2), random.uniform(0.3, 0.7)
            expected += np.outer(surface_of(loadable).weights(centre, radius), traction)
        load = several.draw(number, 7, loadable)
        assert len(load.nodes) <= several.loads_per_sample(loadable)
        np.testing.assert_allclose(load.forces, expected[load.nodes], rtol=1e-13)
        assert not np.delete(expected, load.nodes, axis=0).any()
    assert counts == {1, 2, 3}


@pytest.mark.parametrize(
    ("keys", "said"),
    [({"radius": [0.7, 0.3]}, "low < high"), ({"radius": 0.5, "count": [0, 2]}, "1 <= fewest")],
)
def test_wrong_radius_and_count(keys: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        family("traction_patch", range=[-1, 1], **keys)


def test_patches_on_quadratic_elements() -> None:
    """A case draws them as on linear ones: the resultant is the same to 1e-2, the quadrature's."""
    resultants = []
    for element in ("linear", "quadratic"):
        changes = [
            f"element={element}",
            "load={family: traction_patch, range: [-3, 3], radius: 0.6}",
        ]
        case = read_case("beam2d", changes=changes)
        body = placed(case, case.mesh.raw_mesh())
        loads = [body.loads[number] for number in range(5)]
        assert all((load.between is not None) == (element == "quadratic") for load in loads)
        resultants.append([load.forces.sum(axis=0) for load in loads])
    np.testing.assert_allclose(resultants[0], resultants[1], rtol=1e-2)
