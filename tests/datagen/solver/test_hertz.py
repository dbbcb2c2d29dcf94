r"""A rigid sphere on a half space: Hertz's force of small depths.

.. math:: F = \tfrac43 \frac{E}{1 - ν^2} \sqrt R \, δ^{3/2}

(Johnson 1985, *Contact Mechanics*, chapter 4). A quarter of a block, 130 times as wide as the
contact, stands for the half space.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from datagen import solve
from shared_schema.tools import Sphere

RADIUS, DEPTH, YOUNG, POISSON = 20.0, 0.01, 1000.0, 0.3  # m and Pa
SCRIPT = """SetFactory("OpenCASCADE");
Box(1) = {{0, 0, -60, 60, 60, 60}};
Point(100) = {{0, 0, 0}};
Field[1] = Distance; Field[1].NodesList = {{100}};
Field[2] = Threshold; Field[2].IField = 1; Field[2].LcMin = {size}; Field[2].LcMax = 16;
Field[2].DistMin = 1; Field[2].DistMax = 70;
Background Field = 2;
Mesh.CharacteristicLengthExtendFromBoundary = 0; Mesh.CharacteristicLengthFromPoints = 0;
"""
CASE = f"""name: hertz
mesh: {{kind: file, path: hertz.geo}}
material: {{young_modulus: {YOUNG}, poisson_ratio: {POISSON}, volumetric: paper}}
supports:
  - {{z: -60}}
  - {{x: 0, components: [x]}}
  - {{y: 0, components: [y]}}
load: {{family: random_nodes, region: {{boundary: true, z: 0}}, range: [-1, 1], count: [1, 1]}}
dataset: {{samples: 4, seed: 1, shard_size: 4, test_fraction: 0.5}}
"""


def test_force_of_hertz(tmp_path: Path) -> None:
    """Within 6 % with three linear cells over the radius of the contact; no node is inside."""
    (tmp_path / "hertz.geo").write_text(SCRIPT.format(size=0.14))
    (tmp_path / "hertz.yaml").write_text(CASE)
    tool = Sphere((0.0, 0.0, RADIUS), RADIUS + DEPTH)
    solution = solve(tmp_path / "hertz.yaml", tool=tool)
    contact = solution.contact
    assert contact is not None
    hertz = 4 / 3 * YOUNG / (1 - POISSON**2) * RADIUS**0.5 * DEPTH**1.5
    assert -4 * contact.reaction[2] == pytest.approx(hertz, rel=0.06)
    assert contact.penetration < 1e-12
