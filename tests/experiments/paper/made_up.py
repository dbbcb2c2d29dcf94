"""Resources of made-up datasets, and the results of studies on them."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import cache
from pathlib import Path

import numpy as np
import torch

from experiments.catalogue import find_studies
from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.framework.scale import Scale

SAMPLES = 60


def made_up_resources(
    scale: Scale, folder: Path, make_dataset: Callable[..., Path], sweeps: Collection[str]
) -> Resources:
    """Make all datasets of a scale; sweeps load the corner with vertical forces of −8 to 8 N."""
    for name in scale.datasets:
        dimension = 3 if name.startswith("beam3d") else 2
        forces = None
        if name in sweeps:
            forces = np.zeros((SAMPLES, 2))
            forces[:, 1] = np.linspace(-8, 8, SAMPLES)
        make_dataset(
            folder / "data" / scale.folder_of(name), dimension, name=name, corner_forces=forces
        )
    return Resources(scale, folder / "data", folder / "runs", torch.device("cpu"))


def results(resources: Resources) -> Callable[[str], Findings]:
    """Results of the studies by name, each measured once."""

    @cache
    def measured(name: str) -> Findings:
        _, (study,) = find_studies([name])
        return study.measure(resources)

    return measured
