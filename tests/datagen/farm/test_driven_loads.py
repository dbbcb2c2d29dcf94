"""Pressures, displacements, sliding supports and two materials over ranks that share a solve."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from shared_schema.checker import check_dataset
from shared_schema.dataset_reader import DatasetReader
from tests.datagen.farm_runs import execute

HALVES = """
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 1};
Rectangle(2) = {1, 0, 0, 1, 1};
Coherence;
Physical Surface("soft") = {1};
Physical Surface("stiff") = {2};
Mesh.MeshSizeMax = 0.25;
"""
CASE = {
    "name": "halves",
    "mesh": {"kind": "file", "path": "halves.geo"},
    "material": [
        {"group": "soft", "model": "mooney_rivlin", "c10": 60, "c01": 25, "bulk_modulus": 3000},
        {"group": "stiff", "young_modulus": 900, "poisson_ratio": 0.3},
    ],
    "supports": [{"x": 0, "components": ["x"]}, {"x": 0, "y": 0}],
    "load": [
        {"family": "displacement", "region": {"x": 2}, "range": [0.05, 0.3]},
        {"family": "pressure", "region": {"y": 1}, "range": [1, 20]},
        {"family": "body_force", "region": {}, "range": [-20, 20]},
    ],
    "dataset": {"samples": 4, "seed": 5, "shard_size": 2},
}


@pytest.mark.slow
@pytest.mark.mpi
def test_ranks_that_share_a_solve_find_the_same(tmp_path: Path) -> None:
    (tmp_path / "halves.geo").write_text(HALVES)
    case = tmp_path / "case.yaml"
    case.write_text(yaml.safe_dump(CASE))
    names = ("samples/displacement", "samples/force", "samples/pressure")
    found = []
    for ranks in (1, 2):
        out = tmp_path / f"nodal-{ranks}"
        result = execute(ranks, case, out, "--ranks-per-solve", str(ranks))
        assert result.returncode == 0, result.stderr
        assert check_dataset(out) == []
        found.append(DatasetReader(out).joined(names))
    alone, shared = found
    for name in names:
        scale = np.abs(alone[name]).max()
        np.testing.assert_allclose(shared[name], alone[name], atol=1e-9 * scale, err_msg=name)
    assert np.abs(alone["samples/displacement"]).max() > 0.05
