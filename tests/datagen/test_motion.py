"""Motion of small bodies: closed forms, conservation, order of the scheme, frequencies."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.typing import NDArray
from scipy.linalg import eigh

from datagen.mesh.distributed_mesh import make_mesh
from datagen.mesh.geometries import Box
from datagen.motion.time_stepping import Motion, inertia_of
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.settings import SolverSettings
from shared_schema.common.errors import InputError
from shared_schema.materials import Material, MooneyRivlin, NeoHookean
from shared_schema.motion import Damping, LoadOverTime, TimeSettings

Array = NDArray[np.float64]
SOFT = NeoHookean(young_modulus=500.0, poisson_ratio=0.3, density=100.0)
RUBBER = MooneyRivlin(c10=70.0, c01=25.0, bulk_modulus=400.0, density=100.0)
NOTHING = np.empty(0, dtype=np.int64), np.empty((0, 2))


def body(
    elements: tuple[int, ...] = (4, 2),
    upper: tuple[float, ...] = (2.0, 1.0),
    material: Material = SOFT,
    element: Any = "linear",
    clamped: bool = True,
) -> EquilibriumProblem:
    """A box of some cells, clamped at x = 0 or free to fly."""
    box = Box(kind="box", lower=(0.0,) * len(upper), upper=upper, elements=elements)
    mesh = make_mesh(box, MPI.COMM_SELF)
    held = (mesh.coordinates[:, 0] == 0.0) & clamped
    return EquilibriumProblem(mesh, material, held, SolverSettings(linear_solver="lu"), element)


def moving(
    problem: EquilibriumProblem,
    material: Material = SOFT,
    velocity: Array | None = None,
    history: Any = "held",
    **keys: Any,
) -> Motion:
    """Begin a motion under the load of a problem."""
    settings = TimeSettings(**{"duration": 1e3, "load": history, "step": 0.1, **keys})
    inertia = inertia_of(problem, material, None, settings)
    return Motion(problem, settings, inertia, LoadOverTime.of(history), velocity)


def weigh(problem: EquilibriumProblem, inertia: Any, g: float) -> None:
    """Load a problem of linear elements by its weight along −y, or −z."""
    numbers, dofs = problem.numbering.node_of_block, problem.unknowns.dofs
    nodal = inertia.mass.sum(axis=1)[dofs[:, -1]]
    forces = np.zeros((len(numbers), dofs.shape[1]))
    forces[:, -1] = -g * nodal
    problem.set_load(numbers, forces)


@pytest.mark.parametrize("element", ["linear", "quadratic", "incompressible"])
@pytest.mark.parametrize(
    ("scheme", "mass_matrix"),
    [
        ("generalised-alpha", "consistent"),
        ("generalised-alpha", "lumped"),
        ("energy-momentum", "consistent"),
    ],
)
def test_fall(element: Any, scheme: Any, mass_matrix: Any) -> None:
    """A free body under its weight: u = −g t² / 2 and v = −g t, exactly by both schemes."""
    problem = body((2, 2), element=element, clamped=False)
    settings: dict[str, Any] = {"step": 0.1, "scheme": scheme, "duration": 1.0}
    settings["mass"] = mass_matrix
    if element == "incompressible" and scheme == "energy-momentum":
        with pytest.raises(InputError, match="expected generalised-alpha for incompressible"):
            inertia_of(problem, SOFT, None, TimeSettings(**settings))
        return
    inertia = inertia_of(problem, SOFT, None, TimeSettings(**settings))
    of_points = problem.unknowns.point_dofs
    mass = np.asarray(inertia.mass.sum(axis=1)).ravel()[of_points[:, 0]]
    points = problem.unknowns.points
    forces = np.zeros((len(mass), 2))
    numbers = problem.unknowns.point_numbering.node_of_block
    forces[numbers, 1] = -9.81 * mass
    if points is None:
        problem.set_load(np.arange(len(forces)), forces)
    else:
        on_nodes = points.on_nodes(forces)
        problem.set_load(np.arange(len(on_nodes)), on_nodes, between=forces[points.nodes :])
    motion = moving(problem, **settings)
    for _ in range(10):
        motion.step()
    frame = motion.frame()
    assert frame.displacement[:, 1] == pytest.approx(-9.81 / 2, rel=1e-10)
    assert frame.velocity[:, 1] == pytest.approx(-9.81, rel=1e-10)
    assert np.abs(frame.displacement[:, 0]).max() < 1e-9
    assert frame.energies.kinetic == pytest.approx(200 * 9.81**2 / 2, rel=1e-9)
    assert frame.energies.dissipated == pytest.approx(0.0, abs=1e-9 * 200 * 9.81**2)


@pytest.mark.parametrize(
    "material", [SOFT, pytest.param(RUBBER, marks=pytest.mark.slow)], ids=["neo_hookean", "rubber"]
)
def test_energy_and_momenta_of_free_flight(material: Material) -> None:
    """A stretched body that is thrown and turns: energy and momenta stay, at strains of 30 %."""
    problem = body((3, 2), (1.5, 1.0), material, clamped=False)
    x = problem.mesh.coordinates
    turning = np.stack([-(x[:, 1] - 0.5), x[:, 0] - 0.75], axis=1)
    velocity = np.array([0.3, 1.0]) + 1.5 * turning
    problem.set_load(*NOTHING)
    problem.set_displacement(0.3 * (x - [0.75, 0.5]) * [1.0, -0.5])
    motion = moving(problem, material, velocity, scheme="energy-momentum", step=0.05)
    mass = np.asarray(motion._inertia.mass.sum(axis=1)).ravel()
    of_nodes = mass[problem.unknowns.dofs[:, 0]][np.argsort(problem.numbering.node_of_block)]

    def momenta() -> Array:
        frame = motion.frame()
        full = motion._inertia.mass @ motion._v
        p = np.zeros_like(x)
        p[problem.numbering.node_of_block] = full[problem.unknowns.dofs]
        at = x + frame.displacement
        return np.array([*p.sum(axis=0), (at[:, 0] * p[:, 1] - at[:, 1] * p[:, 0]).sum()])

    first, begin = motion.frame().energies, momenta()
    assert begin[:2] == pytest.approx(of_nodes.sum() * np.array([0.3, 1.0]))
    for _ in range(60):
        motion.step()
    last = motion.frame().energies
    assert last.kinetic + last.strain == pytest.approx(first.kinetic + first.strain, rel=1e-9)
    assert abs(last.strain - first.strain) > 0.2 * first.strain  # it did move
    assert momenta() == pytest.approx(begin, rel=1e-9)


@pytest.mark.parametrize("size", [1.0, 0.1, 1e-3])
def test_energy_of_a_body_that_is_loaded_from_rest(size: float) -> None:
    """What the force does is all there: where cells hardly move, rounding hides no equilibrium."""
    problem = body((8, 2), (4.0, 1.0), SOFT)
    tip = int(np.lexsort(problem.mesh.coordinates.T)[-1])
    problem.set_load(np.array([tip]), np.array([[0.0, -size]]))
    motion = moving(problem, scheme="energy-momentum", step=0.5)
    for _ in range(100):
        motion.step()
    found = motion.frame().energies
    assert motion.halvings == 0
    assert abs(found.dissipated) < 1e-6 * found.work


@pytest.mark.slow
def test_order_two() -> None:
    """A beam that is let fall: the error is a quarter at half the step, by both schemes."""
    found = {}
    for scheme, viscous in (("generalised-alpha", 0.01), ("energy-momentum", 0.01)):
        for steps in (40, 80, 320):
            problem = body((4, 1), (2.0, 0.5))
            damping = Damping(stiffness=viscous)
            keys: dict[str, Any] = {"scheme": scheme, "step": 2.0 / steps, "damping": damping}
            settings = TimeSettings(**keys, duration=2.0)
            weigh(problem, inertia_of(problem, SOFT, None, settings), 0.2)
            motion = moving(problem, **keys)
            for _ in range(steps):
                motion.step()
            found[scheme, steps] = motion.frame().displacement
        fine = found[scheme, 320]
        errors = [np.abs(found[scheme, n] - fine).max() for n in (40, 80)]
        # With an error h² c the reference's own is 1/64 and 1/16 of them: 4 (1 − 1/64) / (1 − 1/16)
        assert errors[0] / errors[1] == pytest.approx(4.2, abs=0.35)
    assert found["generalised-alpha", 320] == pytest.approx(found["energy-momentum", 320], abs=2e-3)


def matrices(problem: EquilibriumProblem, motion: Motion) -> tuple[Array, Array, NDArray[np.intp]]:
    """K and M of the free unknowns at rest, as arrays, and their entries."""
    free = np.setdiff1d(np.arange(problem.size), problem.supports.owned_fixed)
    motion.problem.move(None)
    problem.reset()
    stiffness = problem.tangent()[:, :]
    mass = motion._inertia.mass.toarray()
    return stiffness[np.ix_(free, free)], mass[np.ix_(free, free)], free


def test_a_mode_keeps_its_frequency_and_is_damped() -> None:
    """Small vibrations in a mode: ω of scipy's eigenproblem of K and M, damping ratio b ω / 2.

    The trapezoidal rule (ρ∞ = 1) turns by 2 arctan(ω h / 2) a step; with K–V stresses of b, those
    of a shear modulus μ alone, the free decay of a mode is exp(−ζ ω t) with 2 ζ ω = φᵀ C φ.
    """
    problem = body((8, 2), (2.0, 0.5), element="quadratic")
    problem.set_load(*NOTHING)
    stiffness, mass, free = matrices(problem, moving(problem))
    values, modes = eigh(stiffness, mass)
    omega, mode = math.sqrt(values[0]), modes[:, 0]
    h = 2 * math.pi / omega / 40
    for b in (0.0, 0.02 / omega):
        state = np.zeros(problem.size)
        state[free] = 1e-6 * mode / np.abs(mode).max()
        problem.restore(state)
        damping = Damping(stiffness=b)
        keys: dict[str, Any] = {"dissipation": 1.0, "step": h, "damping": damping}
        motion = moving(problem, **keys)
        amplitude = []
        for _ in range(120):
            motion.step()
            amplitude.append(mode @ mass @ motion._u[free])
        amplitude = np.array(amplitude) / (mode @ mass @ state[free])
        if b == 0.0:
            angle = np.arccos(
                np.clip((amplitude[2:] + amplitude[:-2]) / 2 / amplitude[1:-1], -1, 1)
            )
            turning = np.median(angle)
            assert 2 * math.tan(turning / 2) / h == pytest.approx(omega, rel=1e-6)
            continue
        # Damping of bending with ν = 0.3 in the plane: S_v = 2 μ b Ė lacks λ tr E, so that
        # 2 ζ / (b ω) = φᵀ K_μ φ / φᵀ K φ, with K_μ of the same body with λ = 0, ν = 0.
        shear = NeoHookean(young_modulus=2 * SOFT.lame_mu, poisson_ratio=0.0, density=100.0)
        other = body((8, 2), (2.0, 0.5), shear, "quadratic")
        other.set_load(*NOTHING)
        k_mu, _, _ = matrices(other, moving(other, shear))
        ratio = b / omega / 2 * (mode @ k_mu @ mode) / (mode @ mass @ mode)
        peaks = amplitude[[39, 79, 119]]  # after whole periods
        assert -np.log(peaks[1:] / peaks[:-1]) / (2 * math.pi) == pytest.approx(ratio, rel=5e-3)


def test_cantilever_of_euler_and_bernoulli() -> None:
    """A slender beam in plane strain: ω₁ = 1.8751² √(E' I / (ρ A L⁴)), E' = E / (1 − ν²)."""
    problem = body((40, 1), (20.0, 1.0), element="quadratic")
    problem.set_load(*NOTHING)
    stiffness, mass, _ = matrices(problem, moving(problem))
    values = eigh(stiffness, mass, eigvals_only=True, subset_by_index=[0, 0])
    plane = 500.0 / (1 - 0.3**2)
    expected = 1.87510407**2 * math.sqrt(plane / 12 / 100.0 / 20.0**4)
    assert math.sqrt(values[0]) == pytest.approx(expected, rel=1e-2)


@pytest.mark.parametrize("element", ["linear", "quadratic", "incompressible"])
def test_cells_of_space_swing(element: Any) -> None:
    """One cell in space that is let go keeps its energy, with every kind of element."""
    problem = body((2, 1, 1), (1.0, 0.5, 0.5), element=element)
    force = np.zeros((1, 3))
    force[0, 2] = -0.5
    tip = int(np.argmax(problem.mesh.coordinates.sum(axis=1)))
    problem.set_load(np.array([tip]), force)
    assert problem.solve(1.0).converged
    motion = moving(problem, history="let_go", dissipation=1.0, step=0.01)
    first = motion.frame().energies.strain
    for _ in range(30):
        motion.step()
    last = motion.frame().energies
    assert last.kinetic > 0.1 * first
    assert last.kinetic + last.strain == pytest.approx(first, rel=2e-3)  # the rule is of order 2
    assert last.work == 0.0
