"""Strain energies against the closed form of their derivative, the stress."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from datagen.solver.equilibrium import EquilibriumProblem
from shared_schema.materials import NeoHookean, Volumetric

Matrix = NDArray[np.float64]
ProblemMaker = Callable[..., EquilibriumProblem]

MATERIAL = NeoHookean(young_modulus=500, poisson_ratio=0.4)
GRADIENTS = {
    2: np.array([[0.21, -0.13], [0.34, 0.09]]),
    3: np.array([[0.21, -0.13, 0.05], [0.34, 0.09, -0.2], [0.1, 0.07, -0.15]]),
}
BOTH = pytest.mark.parametrize("volumetric", ["paper", "quadratic"])


def first_piola_kirchhoff(f: Matrix, lam: float, mu: float, volumetric: Volumetric) -> Matrix:
    """P = μ(F − F⁻ᵀ) + U'(J) J F⁻ᵀ, by hand: ∂I_c/∂F = 2F, ∂J/∂F = J F⁻ᵀ.

    paper: U' = λ/2 (J − 1/J), so U' J = λ/2 (J² − 1); quadratic: U' J = λ (J − 1) J.
    """
    j = np.linalg.det(f)
    inverse = np.linalg.inv(f).T
    pressure = lam / 2 * (j**2 - 1) if volumetric == "paper" else lam * (j - 1) * j
    stress: Matrix = mu * (f - inverse) + pressure * inverse
    return stress


def energy_density(f: Matrix, lam: float, mu: float, volumetric: Volumetric) -> float:
    """W(F) as in the docstring of the module, with F₃₃ = 1 in plane strain."""
    full = np.eye(3)
    full[: len(f), : len(f)] = f
    j = np.linalg.det(full)
    u = lam / 4 * (j**2 - 1 - 2 * np.log(j)) if volumetric == "paper" else lam / 2 * (j - 1) ** 2
    return float(mu / 2 * (np.trace(full.T @ full) - 3 - 2 * np.log(j)) + u)


def energy_of(problem: EquilibriumProblem, gradient: Matrix) -> float:
    """Strain energy per volume in the homogeneous state u = H X."""
    x = problem.mesh.coordinates
    problem.set_displacement(x @ gradient.T)
    return problem.energy() / float(np.prod(np.ptp(x, axis=0)))


def test_lame_parameters() -> None:
    """E = 500 Pa, ν = 0.4: λ = 200 / (1.4 · 0.2) = 714.2857… Pa, μ = 500 / 2.8 = 178.571… Pa."""
    assert MATERIAL.lame_lambda == pytest.approx(714.2857142857, rel=1e-12)
    assert MATERIAL.lame_mu == pytest.approx(178.5714285714, rel=1e-12)


@pytest.fixture(params=[(2.0, 1.0), (2.0, 1.0, 1.5)])
def element(request: pytest.FixtureRequest, make_problem: ProblemMaker) -> ProblemMaker:
    """Make a function that builds the problem of one element, in the plane and in space."""
    upper = request.param
    return lambda volumetric: make_problem((1,) * len(upper), upper, volumetric=volumetric)


@BOTH
def test_energy_of_a_homogeneous_state(element: ProblemMaker, volumetric: Volumetric) -> None:
    problem = element(volumetric)
    gradient = GRADIENTS[problem.dimension]
    f = np.eye(problem.dimension) + gradient
    expected = energy_density(f, MATERIAL.lame_lambda, MATERIAL.lame_mu, volumetric)
    assert energy_of(problem, gradient) == pytest.approx(expected, rel=1e-12)


@BOTH
def test_energy_derivative_is_the_stress(element: ProblemMaker, volumetric: Volumetric) -> None:
    """Central differences of W against the closed-form P, component by component."""
    problem = element(volumetric)
    d, step = problem.dimension, 1e-5
    gradient = GRADIENTS[d]
    f = np.eye(d) + gradient
    stress = first_piola_kirchhoff(f, MATERIAL.lame_lambda, MATERIAL.lame_mu, volumetric)
    differences = np.empty((d, d))
    for i, k in np.ndindex(d, d):
        change = np.zeros((d, d))
        change[i, k] = step
        upward, downward = (
            energy_of(problem, gradient + change),
            energy_of(problem, gradient - change),
        )
        differences[i, k] = (upward - downward) / (2 * step)
    assert differences == pytest.approx(stress, rel=1e-7, abs=1e-6)


@BOTH
def test_internal_forces_derive_from_the_energy(
    make_problem: ProblemMaker, volumetric: Volumetric
) -> None:
    """f_int · v = dE(u + s v)/ds at random u and v on a distorted mesh, by central differences."""
    problem = make_problem((4, 3), volumetric=volumetric, distortion=0.08)
    random = np.random.default_rng(0)
    u, v = random.normal(scale=0.03, size=(2, *problem.mesh.coordinates.shape))
    step = 1e-5
    energies = []
    for sign in (1, -1):
        problem.set_displacement(u + sign * step * v)
        energies.append(problem.energy())
    problem.set_displacement(u)
    internal = problem.reactions()
    difference = (energies[0] - energies[1]) / (2 * step)
    assert float((internal * v).sum()) == pytest.approx(difference, rel=1e-7)


@BOTH
def test_tangent_is_the_derivative_of_the_internal_forces(
    make_problem: ProblemMaker, volumetric: Volumetric
) -> None:
    """K v = d f_int(u + s v)/ds in the rows of free nodes, by central differences."""
    problem = make_problem((4, 3), volumetric=volumetric, distortion=0.08)
    free = problem.mesh.coordinates[:, 0] > 1e-9
    random = np.random.default_rng(1)
    u, v = random.normal(scale=0.03, size=(2, *problem.mesh.coordinates.shape)) * free[:, None]
    step = 1e-6
    forces = []
    for sign in (1, -1):
        problem.set_displacement(u + sign * step * v)
        forces.append(problem.reactions())
    difference = (forces[0] - forces[1]) / (2 * step)
    problem.set_displacement(u)
    matrix = problem.tangent()
    x, product = matrix.createVecs()
    x.array_w[:] = v[problem.numbering.node_of_block].ravel()
    matrix.mult(x, product)
    rows = free[problem.numbering.node_of_block]
    found = product.array_r.reshape(-1, 2)[rows]
    assert found == pytest.approx(difference[problem.numbering.node_of_block][rows], abs=1e-5)


@BOTH
def test_frame_indifference(make_problem: ProblemMaker, volumetric: Volumetric) -> None:
    """W(QF) = W(F) and f_int rotates with the body."""
    problem = make_problem((4, 3), volumetric=volumetric)
    x = problem.mesh.coordinates
    u = np.random.default_rng(2).normal(scale=0.03, size=x.shape)
    problem.set_displacement(u)
    energy, forces = problem.energy(), problem.reactions()
    c, s = np.cos(0.9), np.sin(0.9)
    rotation = np.array([[c, -s], [s, c]])
    problem.set_displacement((x + u) @ rotation.T - x)
    assert problem.energy() == pytest.approx(energy, rel=1e-12)
    assert problem.reactions() == pytest.approx(forces @ rotation.T, abs=1e-10)
