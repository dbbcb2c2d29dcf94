"""The least potential energy over the terms of a series."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from shared_schema.materials import NeoHookean
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.compiled.fields import compiled
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.series import compiled_weights
from surrogate.mechanics.series import weights as weights_module
from surrogate.mechanics.series.body_series import BodySeries
from surrogate.mechanics.series.compiled_series import SeriesBody, add_next_term
from surrogate.mechanics.series.compiled_terms import room_for_terms
from surrogate.mechanics.series.compiled_weights import Potential
from surrogate.mechanics.series.series_response import SeriesResponse
from surrogate.mechanics.series.weights import Weights, solved
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load

energy_at = compiled(compiled_weights.energy_at)
set_hessian = compiled(compiled_weights.set_hessian)
potential_of_terms = compiled(compiled_weights.potential_of_terms)
compiled_least_energy = compiled(compiled_weights.least_energy)

ORDER = 3
LOAD = 1.0, -4.0, 2.0


class Terms:
    """Terms of two loads on a small body, with their gradients."""

    def __init__(self, geometry: Geometry, material: NeoHookean = MATERIAL, t: float = 1.0) -> None:
        self.equilibrium = Equilibrium(geometry, material)
        load = t * end_load(geometry, *LOAD[: geometry.dimension])
        self.forces = np.stack([load, -0.5 * load])
        series = BodySeries(self.equilibrium, ORDER)
        first = torch.from_numpy(self.equilibrium.linear_response(self.forces))
        self.terms, self.gradients = series.terms(first)
        self.weights = Weights(series.solid)
        self.potential = self.weights.terms(self.gradients)

    def at(self, c: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        return self.weights.at(c, self.potential)

    def displacement(self, c: torch.Tensor) -> np.ndarray:
        return torch.einsum("nk,knai->nai", c, torch.stack(self.terms)).numpy()

    def least(self) -> torch.Tensor:
        return self.weights(self.gradients)


@pytest.mark.parametrize("volumetric", ["paper", "quadratic"])
@pytest.mark.parametrize("cell_type", ["quad", "triangle", "hexahedron", "tetra"])
def test_energy_is_that_of_the_body(cell_type: str, volumetric: str) -> None:
    """Π against the body's, its derivatives against automatic differentiation."""
    material = NeoHookean.model_validate(
        {"young_modulus": 500, "poisson_ratio": 0.4, "volumetric": volumetric}
    )
    terms = Terms(box(cell_type), material)
    c = torch.tensor([[0.9, 1.1, 0.7], [1.0, 0.5, 2.0]], dtype=torch.float64, requires_grad=True)
    energy, gradient, hessian = terms.at(c)
    expected = terms.equilibrium.potential(terms.displacement(c.detach()), terms.forces)
    np.testing.assert_allclose(energy.detach(), expected, rtol=1e-9)
    (by_autograd,) = torch.autograd.grad(energy.sum(), c)
    torch.testing.assert_close(gradient, by_autograd)
    rows = [torch.autograd.grad(terms.at(c)[1][:, k].sum(), c)[0] for k in range(ORDER)]
    torch.testing.assert_close(hessian, torch.stack(rows, dim=1))
    works = np.einsum("knai,nai->nk", np.stack(terms.terms), terms.forces)
    np.testing.assert_allclose(terms.potential.works, works, rtol=1e-9)


@pytest.mark.parametrize("cell_type", ["quad", "tetra"])
def test_coefficients_are_stationary_and_stable(cell_type: str) -> None:
    terms = Terms(box(cell_type), t=2.0)
    energy, gradient, hessian = terms.at(terms.least())
    scale = terms.potential.stiffness.sqrt()
    assert float((gradient / scale).norm(dim=1).max()) < 1e-5 * float(energy.abs().max().sqrt())
    assert float(torch.linalg.eigvalsh(hessian).min()) > 0
    assert bool((energy < terms.at(torch.ones_like(gradient))[0]).all())


@pytest.mark.parametrize("cell_type", ["quad", "hexahedron"])
def test_closer_than_the_sum(cell_type: str) -> None:
    """Under a load that stretches the sum of three terms by a tenth of the displacement."""
    terms = Terms(box(cell_type), t=3.0)
    errors = []
    for c in (torch.ones(2, ORDER, dtype=torch.float64), terms.least()):
        u = terms.displacement(c)[0]
        exact = correct(terms.equilibrium, terms.forces[0], 0 * u, 1e-12).displacement
        errors.append(np.linalg.norm(u - exact) / np.linalg.norm(exact))
    assert errors[0] > 0.02
    assert errors[1] < errors[0] / 3


def test_under_any_load() -> None:
    """Loads far beyond the convergence of the series leave J positive; no load, no displacement."""
    for t in (0.0, 1e-9, 30.0):
        terms = Terms(box("quad"), t=t)
        c = terms.least()
        assert bool(torch.isfinite(c).all())
        assert not terms.equilibrium.inverted(terms.displacement(c)).any()
    coefficients = Terms(box("quad"), t=1e-3).least()
    torch.testing.assert_close(coefficients[:, 0], torch.ones(2).double(), rtol=0, atol=1e-6)


@pytest.mark.parametrize("volumetric", ["paper", "quadratic"])
@pytest.mark.parametrize("cell_type", ["quad", "hexahedron"])
def test_compiled_energy_is_the_same(cell_type: str, volumetric: str) -> None:
    """Π, its derivatives and its minimum; +∞ where J is not positive."""
    material = NeoHookean.model_validate(
        {"young_modulus": 500, "poisson_ratio": 0.4, "volumetric": volumetric}
    )
    terms = Terms(box(cell_type), material, t=2.0)
    least = terms.least()
    c = torch.tensor([0.9, 1.1, 0.7], dtype=torch.float64)
    energy, gradient, hessian = terms.at(c.expand(2, ORDER))
    for sample in range(2):
        potential, unit = compiled_potential(terms, sample)
        found, of_found = np.empty(ORDER), np.empty((ORDER, ORDER))
        value = energy_at(c.numpy(), potential, found) * unit
        set_hessian(c.numpy(), potential, of_found)
        np.testing.assert_allclose(value, energy[sample], rtol=1e-9)
        np.testing.assert_allclose(found * unit, gradient[sample], rtol=1e-8)
        lower = np.tril_indices(ORDER)  # the upper half is not written
        np.testing.assert_allclose(of_found[lower] * unit, hessian[sample][lower], rtol=1e-9)
        by_newton = compiled_least_energy(potential, np.finfo(float).eps)
        np.testing.assert_allclose(by_newton, least[sample], rtol=1e-5)
        far = torch.tensor([[x, 0, 0] for x in (-30, -10, -3, 3, 10, 30)], dtype=torch.float64)
        energies = [terms.at(c.expand(2, ORDER))[0][sample] for c in far]
        values = [energy_at(c.numpy(), potential, found) * unit for c in far]
        np.testing.assert_allclose(values, energies, rtol=1e-9)
        assert np.inf in values


def compiled_potential(terms: Terms, sample: int) -> tuple[Potential, float]:
    """Π of the terms of one load, and its unit in J."""
    body = SeriesBody.of(terms.equilibrium.solid, np.float64)
    room = room_for_terms(1, ORDER, body.cells, body.stress)
    for k, term in enumerate(terms.terms, start=1):
        u = np.ascontiguousarray(term[sample].numpy())[None]
        add_next_term(k, body.cells, body.stress, body.fibres, u, room, np.zeros_like(u))
    of = body.cells, body.energy, body.fibres, body.moduli
    return potential_of_terms(room.kept[0], *of), body.cells.unit


@pytest.mark.parametrize("cell_type", ["quad", "triangle", "hexahedron", "tetra"])
def test_compiled_terms_are_the_same(cell_type: str) -> None:
    """Terms of one load, also far beyond the range of the series."""
    geometry = box(cell_type)
    response = SeriesResponse(geometry, MATERIAL, order=4)
    for t in (0.5, 2.0, 30.0):
        load = t * end_load(geometry, *LOAD[: geometry.dimension])
        first = torch.from_numpy(Equilibrium(geometry, MATERIAL).linear_response(load[None]))
        nodal = first.transpose(1, 2).contiguous()
        response.series.compiled = False
        expected = response.beyond_first(nodal)
        compiled = response.series.loops(first.numpy())
        for field, other in zip(compiled, expected, strict=True):
            size = float((nodal + expected[0]).abs().max())
            np.testing.assert_allclose(field[0], other[0].T, rtol=0, atol=1e-6 * size)


def test_loads_do_not_depend_on_others() -> None:
    """Small loads converge in two steps; large ones, beside them, in many."""
    geometry = box("quad")
    response = SeriesResponse(geometry, MATERIAL, order=4)
    response.series.compiled = False
    forces = np.random.default_rng(0).normal(size=(64, *geometry.coordinates.shape))
    forces *= np.geomspace(0.1, 4.0, 64)[:, None, None]
    first = torch.from_numpy(Equilibrium(geometry, MATERIAL).linear_response(forces))
    nodal = first.transpose(1, 2)
    together, _ = response.beyond_first(nodal)
    for one, expected in zip(torch.split(nodal, 1), torch.split(together, 1), strict=True):
        found, _ = response.beyond_first(one)
        size = float((one + expected).abs().max())
        torch.testing.assert_close(found, expected, rtol=0, atol=3e-6 * size)


class Beyond(torch.nn.Module):
    """The response beyond u₁ of u₁, as a module."""

    def __init__(self, response: SeriesResponse) -> None:
        super().__init__()
        self.response = response

    def forward(self, nodal: torch.Tensor) -> torch.Tensor:
        return self.response.beyond_first(nodal)[0]


@pytest.mark.slow
def test_exported_files_search_as_long_as_it_takes() -> None:
    """Loads of one step, of many steps, and one that turns points inside out first."""
    geometry = box("quad")
    response = SeriesResponse(geometry, MATERIAL, order=4)
    loads = np.array([0.1, 2.0, 4.0, 30.0])[:, None, None] * end_load(geometry, 1.0, -4.0)
    first = torch.from_numpy(Equilibrium(geometry, MATERIAL).linear_response(loads))
    nodal = first.transpose(1, 2).contiguous()
    response.series.compiled = False
    _, gradients = response.series.terms(first)
    weights = Weights(response.equilibrium.solid)
    potential = weights.terms(gradients)
    fading = weights_module._fading(potential.stiffness)
    assert bool(weights.at(fading, potential)[0].isinf().any())
    expected, _ = response.beyond_first(nodal)
    shapes = ({0: torch.export.Dim("samples")},)
    program = torch.export.export(Beyond(response), (nodal[:2],), dynamic_shapes=shapes)
    for part in ([0], [1], [3], [0, 1, 2, 3]):
        found = program.module()(nodal[part])
        size = nodal[part] + expected[part]
        torch.testing.assert_close(
            found, expected[part], rtol=0, atol=1e-6 * float(size.abs().max())
        )


def test_small_systems() -> None:
    generator = torch.Generator().manual_seed(0)
    root = torch.randn(5, 4, 4, generator=generator, dtype=torch.float64)
    right = torch.randn(5, 4, generator=generator, dtype=torch.float64)
    matrix = root @ root.mT + torch.eye(4)
    torch.testing.assert_close(solved(matrix, right), torch.linalg.solve(matrix, right))
