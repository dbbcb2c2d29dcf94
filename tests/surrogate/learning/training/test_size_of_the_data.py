"""A training says at its start if the displacements that it learns look like wrong units."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.samples import NodalSamples
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.training.loop import train
from surrogate.learning.training.setup import warn_of_size


def of_size(dataset: Dataset, relative: float) -> Dataset:
    """The same samples, whose largest displacements are so large for the body, all alike."""
    force, u = dataset.nodal_test.force, dataset.nodal_test.displacement
    size = np.ptp(dataset.geometry.coordinates, axis=0).max()
    largest = np.linalg.norm(u, axis=2).max(axis=1)[:, None, None]
    return replace(dataset, nodal_test=NodalSamples(force, u * relative * size / largest))


def test_once_with_the_number(
    dataset: Dataset,
    tmp_path: Path,
    make_config: Callable[..., UNetModel],
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The solutions of a mesh in mm with stresses in Pa move by 4e-6 of the body, say."""
    with caplog.at_level(logging.WARNING):
        train(make_config(epochs=2), of_size(dataset, 4e-6), tmp_path / "run", device="cpu")
    (text,) = [line for line in caplog.messages if "units" in line]
    number = len(dataset.nodal_test.displacement)
    assert f"the largest displacement of the {number} test samples is 4e-06 of the body" in text
    assert "mesh.scale" in text


@pytest.mark.parametrize(("relative", "told"), [(0.5, False), (2.0, True), (1e-4, False)])
def test_only_what_is_unusual(
    dataset: Dataset, caplog: pytest.LogCaptureFixture, relative: float, told: bool
) -> None:
    warn_of_size(of_size(dataset, relative))
    assert ("is 2 of the body's size" in caplog.text) == told
    assert bool(caplog.messages) == told
