"""A workshop with small made-up datasets of all names that studies know, and tiny networks.

The body is that of the made-up datasets for every name but those of the 3D beam; sweeps load its
corner with vertical forces, 3.2 times those of the training at the ends.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from surrogate.studies.scale import Scale, merged, read_scale
from surrogate.studies.workshop import Workshop

SAMPLES = 60


def made_up_scale() -> Scale:
    """The scale ``smoke`` without noise and node orders, whose datasets are cases of their own."""
    smoke = read_scale("smoke")
    content = smoke.model_dump()
    for name, spec in content["datasets"].items():
        content["datasets"][name] = {"case": name, "samples": SAMPLES, "grid": spec["grid"]}
    return Scale.model_validate(merged(content, {"name": "made-up"}))


@pytest.fixture(scope="session")
def workshop(
    tmp_path_factory: pytest.TempPathFactory, make_dataset: Callable[..., Path]
) -> Workshop:
    """Datasets by `make_dataset`, networks trained when asked for; not to be changed."""
    scale, folder = made_up_scale(), tmp_path_factory.mktemp("workshop")
    for name, spec in scale.datasets.items():
        dimension = 3 if name.startswith("beam3d") else 2
        forces = None
        if not spec.grid:
            forces = np.zeros((SAMPLES, 2))
            forces[:, 1] = np.linspace(-8, 8, SAMPLES)
        make_dataset(
            folder / "data" / scale.folder_of(name), dimension, name=name, corner_forces=forces
        )
    return Workshop(scale, folder / "data", folder / "runs", torch.device("cpu"))
