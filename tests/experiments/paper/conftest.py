"""Resources of studies: small made-up datasets under the names of the scales, and tiny networks.

All plane datasets have the same body. Sweeps load its corner with vertical forces up to 3.2 times
those of the training.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.framework.scale import Scale, merged, read_scale
from experiments.paper.catalogue import REPRODUCTION
from tests.experiments.paper.made_up import SAMPLES, made_up_resources, results


def made_up_scale() -> Scale:
    """Scale ``smoke`` without noise and node orders; every dataset is a case."""
    smoke = read_scale("smoke", REPRODUCTION.scales)
    content = smoke.model_dump()
    for name, spec in content["datasets"].items():
        content["datasets"][name] = {"case": name, "samples": SAMPLES, "grid": spec["grid"]}
    return Scale.model_validate(merged(content, {"name": "made-up"}))


@pytest.fixture(scope="session")
def resources(
    tmp_path_factory: pytest.TempPathFactory, make_dataset: Callable[..., Path]
) -> Resources:
    """Datasets by `make_dataset`; networks are trained when a test needs them. Read-only."""
    scale, folder = made_up_scale(), tmp_path_factory.mktemp("resources")
    sweeps = [name for name, spec in scale.datasets.items() if not spec.grid]
    return made_up_resources(scale, folder, make_dataset, sweeps)


@pytest.fixture(scope="session")
def result_of(resources: Resources) -> Callable[[str], Findings]:
    """Results of the studies by name, each measured once."""
    return results(resources)
