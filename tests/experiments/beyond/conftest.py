"""Resources of the studies beyond the paper: made-up datasets under the names of scale `smoke`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from experiments.beyond.catalogue import BEYOND
from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.framework.scale import Scale, merged, read_scale
from tests.experiments.paper.made_up import SAMPLES, made_up_resources, results


def made_up_scale() -> Scale:
    """Scale ``smoke`` with as many samples in each dataset as are made up.

    The made-up body in space is loaded on one side only, not symmetrically.
    """
    content = read_scale("smoke", BEYOND.scales).model_dump()
    for name, spec in content["datasets"].items():
        content["datasets"][name] = {"case": name, "samples": SAMPLES, "grid": spec["grid"]}
    for name, run in content["runs"].items():
        if name.startswith("beam3d"):
            run["change"] = merged(run["change"], {"training": {"mirrors": []}})
    return Scale.model_validate(merged(content, {"name": "made-up"}))


@pytest.fixture(scope="session")
def resources(
    tmp_path_factory: pytest.TempPathFactory, make_dataset: Callable[..., Path]
) -> Resources:
    """Datasets by `make_dataset`; networks are trained when a test needs them. Read-only."""
    scale, folder = made_up_scale(), tmp_path_factory.mktemp("beyond")
    sweeps = [name for name in scale.datasets if name.endswith("_sweep")]
    return made_up_resources(scale, folder, make_dataset, sweeps)


@pytest.fixture(scope="session")
def result_of(resources: Resources) -> Callable[[str], Findings]:
    """Results of the studies by name, each measured once."""
    return results(resources)
