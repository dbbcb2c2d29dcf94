from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from experiments.framework.resources import Resources
from experiments.paper.linear_network import PAPER_LINEAR, PAPER_UNET, measure, worse
from shared_schema.manifest import read_manifest, write_manifest
from shared_schema.stiffness import Stiffness, write_stiffness


@pytest.fixture
def with_stiffness(resources: Resources, tmp_path: Path) -> Resources:
    """Resources with a stiffness of 1 N/m at every degree of freedom of the 2D beam."""
    folder = tmp_path / "beam2d-60"
    shutil.copytree(resources.data / folder.name, folder)
    stiffness = Stiffness(np.ones(64), np.arange(64), np.arange(65))
    manifest = read_manifest(folder / "structured")
    assert manifest.structured is not None
    digest = write_stiffness(folder / "structured", stiffness, manifest.case_digest, "quad")
    info = manifest.structured.model_copy(update={"stiffness": digest})
    write_manifest(folder / "structured", manifest.model_copy(update={"structured": info}))
    return Resources(resources.scale, tmp_path, tmp_path / "runs", resources.device)


def test_every_linear_network_beside_the_unet_on_its_data(with_stiffness: Resources) -> None:
    """56 free degrees of freedom: 56² parameters; there is no run of the 3D beam."""
    result = measure(with_stiffness)
    (table,) = result.tables
    assert [row[:2] for row in table.rows] == [("2D beam", "U-Net"), ("2D beam", "linear")]
    for run, row in zip(("beam2d-det", "beam2d-linear"), table.rows, strict=True):
        test = with_stiffness.dataset_of(run).nodal_test
        predicted = with_stiffness.predicted_test(run).mean
        e = 1e3 * np.abs(predicted - test.displacement).mean(axis=(1, 2))
        assert row[3:] == pytest.approx((e.mean(), e.std(ddof=1)))
    assert table.rows[1][2] == pytest.approx(56**2 / 1e6)
    assert result.comparisons == []
    assert len(result.claims) == 1


def test_the_papers_networks() -> None:
    """Table "CNN_MLP": parameters in millions, ē and σ(e) in mm."""
    assert PAPER_UNET.cells() == pytest.approx((94.1, 0.6, 0.3))
    assert PAPER_LINEAR.cells() == pytest.approx((146.3, 7.0, 8.0), abs=0.05)
    assert worse("3D beam", PAPER_LINEAR, PAPER_UNET).holds
