"""The compliance, computed again from mesh and material, against other assemblies of the body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from shared_schema.material import NeoHookean
from surrogate.baselines.linear_map import compliance_of
from surrogate.data.dataset import Dataset
from surrogate.inference.prediction import make_surrogate
from surrogate.mechanics.equilibrium import Equilibrium
from surrogate.mechanics.linear_response import LinearResponse
from surrogate.mechanics.reassembly import COMPLIANCE, compliance, without_reassembled
from surrogate.models.model import Model
from surrogate.runs.configuration import run_config
from surrogate.runs.description import describe
from tests.surrogate.plane_strain import plane_strain_stiffness, sparse

MATERIAL = NeoHookean(young_modulus=500.0, poisson_ratio=0.4)


def test_plane_body(dataset: Dataset) -> None:
    """Bilinear quadrilaterals in plane strain, assembled cell by cell by another code."""
    geometry = dataset.geometry
    free = np.flatnonzero(~geometry.clamped)
    k = sparse(plane_strain_stiffness(geometry))
    expected = compliance_of(k, free, len(geometry.coordinates)).numpy()
    found = compliance(geometry, MATERIAL).numpy()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_order_in_space(dataset_3d: Dataset) -> None:
    """The response to one random force on all nodes: by component, then by free node."""
    geometry = dataset_3d.geometry
    free = ~geometry.clamped
    force = np.random.default_rng(0).normal(size=(1, *geometry.coordinates.shape))
    expected = Equilibrium(geometry, MATERIAL).linear_response(force)[0, free].T.ravel()
    found = compliance(geometry, MATERIAL).numpy() @ force[0, free].T.ravel()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_a_network_loads_without_it(dataset: Dataset) -> None:
    stiff = replace(dataset, stiffness=sparse(plane_strain_stiffness(dataset.geometry)))
    mechanics = {"inputs": ["force", "linear_gradient"], "skip": "linear"}
    config: Model = run_config(
        {"name": "a", "case": "beam2d", "network": {"levels": 1, "channels": 2, **mechanics}}
    )
    network = config.build(stiff.geometry, stiff.info)
    config.start_from_data(network, stiff, stiff.train)
    tensors = {**network.state_dict(), **stiff.geometry.tensors()}
    left = without_reassembled(tensors)
    assert set(tensors) - set(left) == {COMPLIANCE}
    model = make_surrogate(left, describe(config, stiff))
    assert isinstance(model.network.linear, LinearResponse)
    assert isinstance(network.linear, LinearResponse)
    expected = network.linear.compliance
    found = model.network.linear.compliance
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-7 * float(expected.abs().max()))
