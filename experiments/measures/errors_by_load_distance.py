"""Errors under single loads by the distance of the load from the nodes loaded in training."""

from __future__ import annotations

import numpy as np

from surrogate.measures import Extrapolation, node_errors, sample_errors


class ErrorsByLoadDistance:
    """Errors of a network under single loads, in the order of the distance of the load.

    Attributes
    ----------
    order : array of int, (M,)
        Numbers of the samples by the distance of the load from the nodes loaded in training. All
        arrays below are in this order.
    distance : array, (M,)
        Distance of the load in m.
    mean_error, max_error : array, (M,)
        Mean error e_m and largest error of a component, in m.
    moved, error, std : array, (M,)
        Norms ‖u‖₂, ‖U − u‖₂ and ‖σ‖₂ at the loaded node, in m.
    covered : array, (M,)
        Share of the components of all free nodes whose error is inside the 95 % band.
    """

    def __init__(self, loads: Extrapolation) -> None:
        geometry, samples, predicted = loads.surrogate.geometry, loads.samples, loads.predicted
        number = np.arange(len(samples.force))
        node = samples.force.any(axis=2).argmax(axis=1)
        x, trained = geometry.coordinates, geometry.coordinates[geometry.loadable]
        distance = np.linalg.norm(x[node][:, None] - trained, axis=2).min(axis=1)
        self.order = np.argsort(distance, kind="stable")
        self.distance = distance[self.order]
        mean, reference = predicted.mean[self.order], samples.displacement[self.order]
        self.mean_error = sample_errors(mean, reference)
        self.max_error = np.abs(mean - reference).max(axis=(1, 2))
        there = number, node[self.order]
        self.moved = np.linalg.norm(reference[there], axis=1)
        self.error = node_errors(mean, reference)[there]
        self.std = np.linalg.norm(predicted.std[self.order][there], axis=1)
        self.covered = loads.inside[self.order]
