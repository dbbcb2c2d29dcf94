"""Families of random loads: numbers, places and sizes as their texts say."""

from __future__ import annotations

import numpy as np
import pytest

from shared_schema.common.errors import InputError
from surrogate.learning.data.case_loads import RandomLoads, random_loads
from surrogate.learning.inference.loading import load
from tests.surrogate.mechanics.bodies import box

LIMIT = (2.0, 3.0)
TRAINED = 1, 4


def family(text: str) -> RandomLoads:
    return random_loads(text, box("quad"), LIMIT, TRAINED)


def test_family_of_the_training() -> None:
    """1 to 4 of the 24 free nodes; components are even in ±limit: their mean square is limit²/3."""
    force = family("trained").draw(2000, np.random.default_rng(0))
    loaded = force.any(axis=2)
    counts = np.bincount(loaded.sum(axis=1), minlength=6)
    assert counts[[0, 5]].tolist() == [0, 0]
    assert counts[1:5] == pytest.approx([500] * 4, abs=3 * np.sqrt(2000 * 3 / 16))
    np.testing.assert_array_equal(loaded.any(axis=0), ~box("quad").clamped)
    components = force[loaded]
    assert (components**2).mean(axis=0) == pytest.approx(np.array(LIMIT) ** 2 / 3, rel=0.05)
    assert np.abs(components).max(axis=0) == pytest.approx(LIMIT, rel=0.01)


def test_other_numbers_and_sizes() -> None:
    force = family("loads=6-8,reach=2").draw(300, np.random.default_rng(0))
    assert set(force.any(axis=2).sum(axis=1)) == {6, 7, 8}
    assert np.abs(force).max(axis=(0, 1)) == pytest.approx([4.0, 6.0], rel=0.02)
    assert set(family("loads=3").draw(9, np.random.default_rng(0)).any(axis=2).sum(axis=1)) == {3}


def test_places() -> None:
    """In space the surface leaves out the inner nodes: 3 of the 36 free ones of 5 × 3 × 3."""
    body = box("hexahedron")
    everywhere, surface = (
        random_loads(f"places={where}", body, (1.0, 1.0, 1.0), (1, 1))
        for where in ("free", "surface")
    )
    assert len(everywhere.nodes) == 36
    inner = np.setdiff1d(everywhere.nodes, surface.nodes)
    np.testing.assert_allclose(body.coordinates[inner][:, 1:], 0.5)
    assert len(inner) == 3
    assert (everywhere.fewest, everywhere.most) == (1, 1)


def test_draws_depend_on_the_generator_alone() -> None:
    first, second = (family("trained").draw(5, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "'', expected 'trained', or some of"),
        ("size=3", "'size', expected"),
        ("loads=many", "'loads' = many, expected a number such as 3"),
        ("loads=0-2", "'loads' = 0-2, expected 1 at least and 24 at most"),
        ("loads=25", "'loads' = 25-25"),
        ("reach=-1", "'reach' = -1, expected a positive number"),
        ("reach=nan", "'reach' = nan"),
        ("places=inside", "'places' = inside, expected one of trained, surface, free"),
    ],
)
def test_wrong_families(text: str, part: str) -> None:
    with pytest.raises(InputError) as error:
        family(text)
    assert part in str(error.value)
    assert str(error.value).startswith(f"family '{text}': ")


def test_numbers_of_loads_of_older_runs() -> None:
    """Those of the case, as the run folder does not have those of the training."""
    data = load("beam3d_any_reduced").description.data
    assert data.loads is not None
    data = data.model_copy(update={"loads": None})
    assert data.load_numbers == (1, 4)
