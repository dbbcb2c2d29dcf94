"""Random loads of a case's own families: body forces and patches of traction."""

from __future__ import annotations

from typing import Any

import numpy as np

from surrogate.learning.data.case_loads import CaseLoads, RandomLoads, trained_loads
from tests.surrogate.mechanics.bodies import box

WEIGHT = {"family": "body_force", "range": [-3.0, 5.0]}
PATCHES = {
    "family": "traction_patch",
    "region": {"boundary": True, "x": None},
    "range": [-2.0, 2.0],
    "radius": [0.4, 0.5],
    "count": [1, 3],
}
BOX = box("hexahedron")


def loads_of(*families: dict[str, Any]) -> Any:
    return trained_loads(BOX, {"load": list(families)}, (1.0, 1.0, 1.0), (1, 4))


def test_body_force() -> None:
    """Nodal forces are uniform densities times nodal volumes; supports bear what acts on them."""
    forces = loads_of(WEIGHT).draw(400, np.random.default_rng(1))
    free = ~BOX.clamped
    assert not forces[:, BOX.clamped].any()
    first = forces[:, free][:, 0]
    shares = forces[:, free] / first[:, None]
    np.testing.assert_allclose(shares, np.broadcast_to(shares[:1], shares.shape), rtol=1e-12)
    ends = first.min(axis=0) / first.max(axis=0)
    np.testing.assert_allclose(ends, -3 / 5, rtol=0.03)


def test_patches() -> None:
    """One to three patches of the surface, each of the integral π R²/3 on a flat face."""
    forces = loads_of(PATCHES).draw(300, np.random.default_rng(2))
    surface = np.zeros(len(BOX.coordinates), bool)
    surface[BOX.surface_nodes] = True
    assert not forces[:, ~surface | BOX.clamped].any()
    assert forces.any(axis=(1, 2)).all()
    largest = 3 * 2.0 * np.pi * 0.5**2 / 3
    total = np.abs(forces.sum(axis=1)).max()
    assert 0.3 * largest < total < 1.2 * largest  # coarse quadrature; patches lap over edges


def test_sum_of_families_and_others() -> None:
    together = loads_of(WEIGHT, PATCHES).draw(3, np.random.default_rng(3))
    assert (together != 0).any(axis=2).sum(axis=1).min() == (~BOX.clamped).sum()
    assert isinstance(loads_of(WEIGHT), CaseLoads)
    part = {**WEIGHT, "region": {"box": [[0, 0, 0], [1, 1, 1]]}}
    assert isinstance(loads_of(part), RandomLoads)
    assert isinstance(loads_of({"family": "random_nodes", "range": [-1, 1]}), RandomLoads)
    assert isinstance(trained_loads(BOX, {}, (1.0, 1.0, 1.0), (1, 4)), RandomLoads)
    wider = trained_loads(BOX, {"load": WEIGHT}, (1.0, 1.0, 1.0), (1, 4), "loads=1-2,reach=2")
    assert isinstance(wider, RandomLoads)
