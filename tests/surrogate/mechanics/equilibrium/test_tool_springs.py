"""Springs to a rigid tool: forces and tangent are derivatives of the potential."""

from __future__ import annotations

import numpy as np
import pytest

from shared_schema.tools import Plane, Sphere, Tool
from surrogate.mechanics.equilibrium.tool_springs import ToolSprings

TOOLS = [Sphere((0.5, 0.5), 0.6), Plane((0.5, 0.5), (1.0, 2.0)), Sphere((0.5, 0.4, 0.6), 0.7)]


@pytest.mark.parametrize("tool", TOOLS, ids=lambda tool: f"{type(tool).__name__}{tool.dimension}")
def test_derivatives(tool: Tool) -> None:
    rng, d, h = np.random.default_rng(0), tool.dimension, 1e-6
    x, nodes = rng.uniform(0, 1, (9, d)), np.array([0, 2, 3, 7, 8])
    stiffness, multipliers = rng.uniform(1, 3, (2, 5))
    springs = ToolSprings(tool, nodes, x[nodes], stiffness, multipliers * (rng.random(5) < 0.6))
    u = 0.1 * rng.normal(size=x.shape)
    forces, (bear, blocks) = springs.forces(u), springs.tangent(u)
    assert 0 < len(bear) <= 5
    whole = np.zeros((9, d, 9, d))
    whole[bear[:, 0], :, bear[:, 0]] = blocks
    for node in range(9):
        for axis in range(d):
            step = np.zeros_like(u)
            step[node, axis] = h
            slope = (springs.potential(u + step) - springs.potential(u - step)) / (2 * h)
            assert -forces[node, axis] == pytest.approx(slope, abs=1e-7)
            bent = (springs.forces(u - step) - springs.forces(u + step)) / (2 * h)
            np.testing.assert_allclose(whole[:, :, node, axis], bent, atol=1e-6)


def test_withdrawn_springs_push_less() -> None:
    tool = Plane((0.0, 0.0), (0.0, 1.0))
    x, still = np.array([[0.0, -0.2], [1.0, 0.3]]), np.zeros((2, 2))
    stiffness, nothing = np.array([2.0, 2.0]), np.zeros(2)
    for back, force in ((0.0, 0.4), (0.15, 0.1)):
        springs = ToolSprings(tool, np.array([0, 1]), x, stiffness, nothing, back)
        expected = np.array([[0.0, force], [0.0, 0.0]])
        np.testing.assert_allclose(springs.forces(still), expected, atol=1e-15)
