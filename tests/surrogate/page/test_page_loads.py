"""What loads a page offers, by the families of the case."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.page.page_loads import FINGER, load_arrays, page_loads, patches_of
from tests.surrogate.page.runs import untrained

NODE = {"family": "random_node", "range": [-1, 2]}
WEIGHT = {"family": "body_force", "range": [-3, 2], "region": {"x": None}}
PATCH = {"family": "traction_patch", "range": [-5, 4], "radius": [0.5, 0.7]}
PART = {**WEIGHT, "region": {"x": "> 1"}}


def model_of(dataset: Dataset, folder: Path, families: Any) -> Surrogate:
    """A network of a case with other loads."""
    case = {**dataset.manifest.case, "load": families}
    manifest = dataset.manifest.model_copy(update={"case": case})
    data = replace(dataset, manifest=manifest)
    return load(untrained(folder / "run", data, data.geometry, {}))


@pytest.mark.parametrize(
    ("families", "given", "radius", "density"),
    [
        (NODE, None, 0.0, None),
        (NODE, 0.6, 0.6, None),
        ([WEIGHT, PATCH], None, 0.6, 3.0),
        ([WEIGHT, PATCH], 0.0, 0.0, 3.0),
        ([WEIGHT, NODE], None, 0.0, 3.0),
        (PATCH, None, 0.6, None),
        (PART, None, 0.0, None),
    ],
)
def test_loads_are_those_of_the_case(
    dataset_3d: Dataset,
    tmp_path: Path,
    families: Any,
    given: float | None,
    radius: float,
    density: float | None,
) -> None:
    found = page_loads(model_of(dataset_3d, tmp_path, families), given)
    assert found.radius == pytest.approx(radius)
    assert found.density == (None if density is None else (density,) * 3)
    arrays = load_arrays(dataset_3d.geometry, found, np.array([5, 8]))
    assert ("volumes" in arrays) == (density is not None)
    assert ("patches/starts" in arrays) == (radius > 0)


def test_weight_alone_is_touched_by_a_finger(dataset_3d: Dataset, tmp_path: Path) -> None:
    found = page_loads(model_of(dataset_3d, tmp_path, WEIGHT))
    size = np.ptp(dataset_3d.geometry.coordinates, axis=0)
    assert found.radius == pytest.approx(FINGER * float(np.linalg.norm(size)))
    assert found.largest == pytest.approx((FINGER * 3 * float(size.prod()),) * 3)  # of a box


def test_force_about_a_node_reaches_a_part_of_the_boundary(dataset_3d: Dataset) -> None:
    """Its resultant is the force; inner nodes bear theirs alone."""
    geometry = dataset_3d.geometry
    everywhere = np.arange(len(geometry.coordinates))
    weights = patches_of(geometry, 0.6, everywhere)
    assert weights.sum(axis=1) == pytest.approx(np.ones(len(everywhere)))
    inner = np.setdiff1d(everywhere, geometry.surface_nodes)
    np.testing.assert_array_equal(weights[inner].toarray(), np.eye(len(everywhere))[inner])
    np.testing.assert_array_equal(
        weights[[7]].toarray(), patches_of(geometry, 0.6, everywhere[7:8]).toarray()
    )
    assert np.count_nonzero(weights[geometry.surface_nodes].toarray()) > 2 * len(everywhere)
    reached = weights.tocoo()
    distance = np.linalg.norm(
        geometry.coordinates[reached.row] - geometry.coordinates[reached.col], axis=1
    )
    assert distance.max() < 0.6 + 1.0  # a facet that is reached is at most so long
