"""Predictions under loads outside the training data, beside the equilibria."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surrogate.learning.data.body_check import BodyRecord, require_same_body
from surrogate.learning.data.samples import NodalSamples, read_nodal_dataset
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.measures.error_metrics import sample_errors
from surrogate.learning.probabilistic.calibration import half_width
from surrogate.learning.probabilistic.distribution import Distribution
from surrogate.mechanics.body.geometry import at_free

Array = NDArray[np.float64]
BAND = 0.95


@dataclass(frozen=True)
class Extrapolation:
    """Predicted distributions under the loads of another dataset of the same body.

    Attributes
    ----------
    case : str
        Name of the case of the other dataset.
    surrogate : Surrogate
    samples : NodalSamples
        Loads and equilibria.
    predicted : Distribution
        Predictions for the same loads.
    """

    case: str
    surrogate: Surrogate
    samples: NodalSamples
    predicted: Distribution

    @cached_property
    def reach(self) -> Array:
        """Ratio of the largest force component to that in training, (M,): outside above 1."""
        limit = max(self.surrogate.description.data.info.force.max_abs)
        return np.abs(self.samples.force).max(axis=(1, 2)) / limit

    @cached_property
    def inside(self) -> Array:
        """Share of the free components of each sample with the error inside the 95 % band, (M,)."""
        free = self.surrogate.geometry.free
        error = at_free(np.abs(self.predicted.mean - self.samples.displacement), free)
        band = half_width(BAND) * at_free(self.predicted.std, free)
        return (error <= band).mean(axis=(1, 2))

    @cached_property
    def node(self) -> int | None:
        """Node that all samples load, or None if they load several."""
        loaded = np.flatnonzero(self.samples.force.any(axis=(0, 2)))
        return int(loaded[0]) if len(loaded) == 1 else None

    def plain(self) -> dict[str, Any]:
        """Measures of every sample as plain data; errors and standard deviations in m."""
        free = self.surrogate.geometry.free
        columns = {
            "reach": self.reach,
            "mean_error": sample_errors(self.predicted.mean, self.samples.displacement),
        }
        if self.surrogate.is_probabilistic:
            columns["mean_std"] = at_free(self.predicted.std, free).mean(axis=(1, 2))
            epistemic = at_free(self.predicted.std_epistemic, free)
            columns["mean_std_epistemic"] = epistemic.mean(axis=(1, 2))
            columns["inside_95"] = self.inside
        return {"case": self.case} | {name: values.tolist() for name, values in columns.items()}


def extrapolate(surrogate: Surrogate, nodal: Path, passes: int, seed: int) -> Extrapolation:
    """Predict the samples of a nodal dataset of the same body.

    Parameters
    ----------
    surrogate : Surrogate
    nodal : Path
        A nodal dataset of the same mesh, supports and material, with any loads.
    passes, seed : int
        Number and seed of the stochastic passes.

    Raises
    ------
    InputError
        If the dataset is missing, damaged, or of another body.
    """
    dataset = read_nodal_dataset(nodal)
    require_same_body(
        BodyRecord(surrogate.description.data.case, surrogate.geometry.arrays()),
        BodyRecord(dataset.manifest.case, {"coordinates": dataset.coordinates}),
        f"--loads '{nodal}': another body than the run's",
    )
    samples = dataset.samples
    predicted = surrogate.passes_in_shapes(samples.force, samples.parameters, passes, seed)
    return Extrapolation(dataset.manifest.name, surrogate, dataset.samples, predicted)
