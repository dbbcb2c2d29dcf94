"""Equilibria in the modes of a reduced network: energy, cubature, predictions and refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from shared_schema.common.errors import InputError
from surrogate.contrib.modal_fit import fit_balance
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.export import export, load_exported
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.modal_cubature import balance, modes_of
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.mechanics.modal_equilibrium import BalancedCoefficients, Cubature, ModalEquilibrium
from surrogate.mechanics.modal_equilibrium.compiled_energy import energy_at
from tests.surrogate.learning.networks.test_reduced_network import reduced
from tests.surrogate.resuming import trained


@pytest.fixture(scope="module")
def run(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return trained(reduced(), dataset, tmp_path_factory.mktemp("reduced") / "run").folder


def whole(model: Surrogate) -> ModalEquilibrium:
    """The equilibrium by all quadrature points."""
    solid = model.body.equilibrium.solid
    volumes = solid.volumes.numpy()
    cells, points = np.divmod(np.arange(volumes.size), volumes.shape[1])
    every = Cubature(cells, points, volumes.ravel())
    modes, body = modes_of(model), (solid.cells.numpy(), solid.gradients.numpy())
    return ModalEquilibrium(modes, *body, every, solid.laws, leading=3)


def test_energy_and_derivatives_are_those_of_the_solid(run: Path) -> None:
    model = load(run)
    body, modes = whole(model), modes_of(model)
    a = np.random.default_rng(0).normal(size=len(modes)) * 0.1
    u = torch.from_numpy(np.einsum("m,mni->ni", a, modes)[None])
    solid, gradient = model.body.equilibrium.solid, np.empty_like(a)
    energy = energy_at(body.points, a, np.zeros_like(a), gradient)
    assert energy == pytest.approx(float(solid.energy(u)), rel=1e-4)
    forces = solid.internal_forces(u)[0].numpy()
    expected = np.einsum("mni,ni->m", modes, forces)
    np.testing.assert_allclose(gradient, expected, atol=1e-5 * np.abs(expected).max())
    of_points = body.forces_of_points(a).sum(axis=1)
    np.testing.assert_allclose(of_points, expected, atol=1e-5 * np.abs(expected).max())
    up, down = np.empty_like(a), np.empty_like(a)
    change = np.random.default_rng(1).normal(size=len(a)) * 1e-2
    for sign, out in ((1, up), (-1, down)):
        energy_at(body.points, a + sign * change, np.zeros_like(a), out)
    stiffness = body.tangent(a) @ change
    np.testing.assert_allclose((up - down) / 2, stiffness, atol=1e-3 * np.abs(stiffness).max())


def test_the_search_ends_where_the_forces_in_modes_balance(run: Path) -> None:
    model = load(run)
    body, rng = whole(model), np.random.default_rng(2)
    for _ in range(5):
        force = body.stiffness @ rng.normal(size=len(body.stiffness)) * 0.2
        found = body(force, np.zeros_like(force)) + body.linear(force)
        gradient = np.empty_like(found)
        energy_at(body.points, found, force, gradient)
        left = np.linalg.solve(body.tangent(found), gradient)
        assert np.linalg.norm(left) < 2e-3 * np.linalg.norm(found)


def test_a_few_points_are_as_good_as_all(run: Path, dataset: Dataset) -> None:
    model, few = load(run), load(run)
    solid = model.body.equilibrium.solid
    unit = float(model.network.force_scale * model.network.displacement_scale.flatten()[0])
    model.network.network.equilibrium = BalancedCoefficients(whole(model), unit)  # type: ignore[assignment]
    cubature = fit_balance(few, points=40, loads=30)
    assert len(cubature.weights) <= 40 < solid.volumes.numel()
    assert cubature.weights.sum() == pytest.approx(float(solid.volumes.sum()), rel=0.05)
    balance(few, cubature)
    force = dataset.nodal_test.force
    exact, found = model.predict(force), few.predict(force)
    truth = dataset.nodal_test.displacement
    assert np.abs(found - exact).mean() < 0.02 * np.abs(truth).mean()
    np.testing.assert_allclose(few.averaged_passes(force).mean, found, atol=1e-5)
    alone = 1e-4 * force[:4]  # answered as by a linear body
    linear = np.stack(
        [np.asarray(few.body.equilibrium.newton_step(*at_rest(few, f))[0]) for f in alone]
    )
    size = np.abs(linear).max()
    np.testing.assert_allclose(few.predict(alone), linear[:, 0], atol=2e-3 * size)


def at_rest(model: Surrogate, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The undeformed body, and what is out of balance there."""
    nothing = np.zeros((1, *force.shape))
    return nothing, model.body.equilibrium.out_of_balance(nothing, force[None])


def test_predictions_are_differentiable_by_the_forces(run: Path, dataset: Dataset) -> None:
    model = load(run)
    balance(model, fit_balance(model, points=40, loads=20))
    force = torch.from_numpy(dataset.nodal_test.force[:1]).double().requires_grad_()
    weights = torch.linspace(0, 1, force.numel()).double().reshape(force.shape)
    torch.autograd.backward((model.predict(force) * weights).sum())
    assert force.grad is not None
    change = torch.zeros_like(force)
    change[0, int(np.flatnonzero(model.geometry.loadable)[-1])] = 0.05
    difference = (model.predict(force + change) - model.predict(force - change)).detach() / 2
    expected = float((difference * weights).sum())
    assert float((force.grad * change).sum()) == pytest.approx(expected, rel=0.05)


def test_a_run_keeps_its_cubature_and_a_file_has_the_network_alone(
    run: Path, tmp_path: Path, dataset: Dataset
) -> None:
    from surrogate.command_line import main

    copy, force = tmp_path / "copy", dataset.nodal_test.force
    words = [str(run), "--points", "30", "--loads", "20", "--out", str(copy)]
    assert main(["balance", *words]) == 0
    balanced, plain = load(copy).predict(force), load(run).predict(force)
    assert np.abs(balanced - plain).max() > 1e-6
    export(copy, tmp_path / "network.pt2", format="pt2")
    exported = load_exported(tmp_path / "network.pt2")(torch.from_numpy(force).float())
    np.testing.assert_allclose(exported["displacement"].numpy(), plain, atol=1e-5)


def test_other_networks_are_refused(trained_bayes: Path, run: Path) -> None:
    with pytest.raises(InputError, match="expected a single deterministic reduced network"):
        fit_balance(load(trained_bayes))
    with pytest.raises(InputError, match="points 0: expected 1 at least"):
        fit_balance(load(run), points=0)
