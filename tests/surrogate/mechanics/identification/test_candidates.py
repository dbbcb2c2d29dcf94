"""Probabilities of the places of a force, against whole fits at every node of the surface."""

from __future__ import annotations

import numpy as np
import pytest

import surrogate
from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.common.errors import WorkError
from surrogate.mechanics.identification.least_squares import fit, wild_cost
from surrogate.mechanics.identification.responses import Response
from surrogate.mechanics.identification.search import MarkerFits
from surrogate.mechanics.identification.unknowns import Unknowns
from tests.surrogate.mechanics.identification.test_identification import NOISE, seen


@pytest.mark.parametrize("load", ["3.2,1:0.4,-1", "2.13333,0:0,3"])
def test_one_step_gives_the_probabilities_of_whole_fits(load: str) -> None:
    """Each fit begins at rest; both know the noise."""
    beam = surrogate.load("beam2d_any")
    geometry = beam.geometry
    truth = beam.solve(load, nearest=True, correct=True).displacement
    markers = seen(beam, truth)
    at_markers = markers.interpolation(geometry)
    unknowns = Unknowns.of(geometry, ["somewhere"], CommandLoads(geometry.loaded_body), np.empty(0))
    candidates = MarkerFits(beam, markers.moved, at_markers, NOISE).somewhere(unknowns, [0.0])
    shares = {one.node: one.share for one in candidates if one.node is not None}
    assert len(shares) > 2
    assert list(shares.values()) == sorted(shares.values(), reverse=True)

    nodes = geometry.surface_nodes[geometry.free[geometry.surface_nodes].all(axis=1)]
    likelihood = {}
    for node in map(int, nodes):
        scale = np.full(2, 1.0)
        units = np.zeros((2, *truth.shape))
        units[[0, 1], node, [0, 1]] = 1.0
        response = Response(beam, unknowns.at(units, "force"), at_markers, scale)
        try:
            found = fit(response.model, markers.moved, np.zeros(2), scale, NOISE)
        except WorkError:
            continue
        likelihood[node] = np.exp(-wild_cost(found.lengths, NOISE) / 2)
    total = sum(likelihood.values())
    apart = sum(
        abs(shares.get(node, 0.0) - likelihood.get(node, 0.0) / total)
        for node in set(shares) | set(likelihood)
    )
    assert apart / 2 < 0.05
    best = max(likelihood, key=lambda node: likelihood[node])
    assert candidates[0].node == best
    same = next(one for one in candidates if one.node == best)
    assert same.fit.counts.sum() == markers.moved.shape[0] - 2  # the swapped ones are left out
