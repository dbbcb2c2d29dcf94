"""Predictions of a run beside the equilibria: of its test split, or of other loads on the body."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from experiments.framework.resources import Resources
from surrogate.learning.data import Geometry, at_free
from surrogate.learning.measures import BAND, sample_errors
from surrogate.learning.probabilistic import Distribution, half_width
from surrogate.mechanics.certify import FastCertificate

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
MOST_PLACES, GROUPS = 8, 6  # distances that are shown one by one; else groups of equal size


@dataclass(frozen=True)
class PredictedSamples:
    """Loads, equilibria and predictions.

    Attributes
    ----------
    geometry : Geometry
        Body that the network was trained on.
    force, reference : array, (M, n_nodes, d)
        Forces in N, displacements in m.
    predicted : Distribution
    certificate : FastCertificate or None
        Fast certificate of the run; None without held-out samples, or if it was not asked for.
    """

    geometry: Geometry
    force: Array
    reference: Array
    predicted: Distribution
    certificate: FastCertificate | None = None

    @cached_property
    def error(self) -> Array:
        """Mean error e_m of every sample in m, (M,)."""
        return sample_errors(self.predicted.mean, self.reference)

    @cached_property
    def moved(self) -> Array:
        """Mean size of the displacement components of every sample in m, (M,)."""
        return np.abs(self.reference).mean(axis=(1, 2))

    @cached_property
    def std(self) -> Array:
        """Mean σ of every sample over its free components in m, (M,)."""
        return np.asarray(at_free(self.predicted.std, self.geometry.free).mean(axis=(1, 2)))

    @cached_property
    def inside(self) -> Mask:
        """Components inside their 95 % intervals, (M, n_nodes, d)."""
        error = np.abs(self.predicted.mean - self.reference)
        return np.asarray(error <= half_width(BAND) * self.predicted.std)

    @cached_property
    def inside_with_size(self) -> Mask:
        """The same, in the intervals that have the size of the fast estimate."""
        assert self.certificate is not None
        mean, std = self.predicted.mean, self.predicted.std
        return self.certificate.inside(self.force, mean, self.reference, std, BAND)

    @cached_property
    def covered(self) -> Array:
        """Share of the free components of every sample inside their 95 % intervals, (M,)."""
        return at_free(self.inside, self.geometry.free).mean(axis=(1, 2))

    @cached_property
    def covered_with_size(self) -> Array:
        """The same, in the intervals that have the size of the fast estimate, (M,)."""
        return at_free(self.inside_with_size, self.geometry.free).mean(axis=(1, 2))

    @property
    def loaded(self) -> Mask:
        """Loaded nodes of every sample, (M, n_nodes)."""
        return np.any(self.force, axis=2)

    @property
    def number(self) -> NDArray[np.int64]:
        """Number of loaded nodes of every sample, (M,)."""
        return self.loaded.sum(axis=1)

    def relative(self, where: Mask) -> float:
        """Error over displacement of some samples (M,): the ratio of their means."""
        return float(self.error[where].mean() / self.moved[where].mean())


def predicted_samples(
    resources: Resources, run: str, dataset: str | None = None, certified: bool = False
) -> PredictedSamples:
    """Predict the samples of a dataset by a run; without `dataset`, those of its test split.

    With its fast certificate, if that is asked for.
    """
    certificate = resources.fast_certificate(run) if certified else None
    if dataset is None or dataset not in resources.scale.datasets:
        own = resources.dataset_of(run)
        test, predicted = own.nodal_test, resources.predicted_test(run)
        fields = test.force, test.displacement, predicted, certificate
        return PredictedSamples(own.geometry, *fields)
    loads = resources.predicted_loads(run, dataset)
    samples, geometry = loads.samples, loads.surrogate.geometry
    fields = samples.force, samples.displacement, loads.predicted, certificate
    return PredictedSamples(geometry, *fields)


def distance_from(samples: PredictedSamples, nodes: Mask) -> Array:
    """Distance in m of the load of each single-load sample from the nearest of some nodes, (M,)."""
    x = samples.geometry.coordinates
    to_nodes: Array = np.linalg.norm(x[:, None] - x[nodes], axis=2).min(axis=1)
    return to_nodes[samples.loaded.argmax(axis=1)]


def distance_groups(distance: Array) -> list[tuple[float, Mask]]:
    """Group samples by distance (M,): mean distances in m, ascending, and masks (M,).

    Few different distances are a group each. Of more, zero is one; the others are divided into
    groups of equal size.
    """
    rounded = distance.round(6)
    places = np.unique(rounded)
    if len(places) <= MOST_PLACES:
        return [(float(place), rounded == place) for place in places]
    groups = [rounded == 0] if (rounded == 0).any() else []
    ends = np.unique(np.quantile(rounded[rounded > 0], np.linspace(0, 1, GROUPS + 1)))
    groups += [
        (rounded > 0) & (rounded >= low) & ((rounded < high) | (high == ends[-1]))
        for low, high in pairwise(ends)
    ]
    return [(float(distance[group].mean()), group) for group in groups]
