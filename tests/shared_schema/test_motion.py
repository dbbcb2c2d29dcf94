"""Schemes of time steps on an oscillator, masses of elements, loads over time, settings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from shared_schema.common.bodies.points_between import PointsBetween
from shared_schema.common.bodies.reference_cells import CORNERS, NAMES, points_of
from shared_schema.common.configuration import validate
from shared_schema.common.errors import InputError
from shared_schema.materials import NeoHookean, material_of
from shared_schema.motion import (
    LoadOverTime,
    Scheme,
    TimeSettings,
    densities_of_cells,
    mass_blocks,
    mass_matrix,
    read_history,
)

OMEGA = 3.0
Array = NDArray[np.float64]


def oscillated(rule: Scheme, duration: float, u: float, v: float) -> tuple[float, float]:
    """Displacement and velocity of u'' + c u' + ω² u = 0 at the end, each step solved exactly."""
    c = rule.mass_damping
    a, last, slope = -(OMEGA**2) * u - c * v, OMEGA**2 * u + c * v, OMEGA**2
    for _ in range(round(duration / rule.step)):
        begun = rule.begin(u, v, a)
        if rule.between:  # the internal force of a linear spring is that of the mean
            new = rule.spring * begun.u - begun.g - rule.carried * last - slope * u / 2
            new /= rule.spring + slope / 2
        else:
            new = rule.spring * begun.u - begun.g - rule.carried * last
            new /= rule.spring + slope
        u, v, a = new, rule.velocity(begun, new), rule.acceleration(begun, new)
        last = OMEGA**2 * u + c * v
    return u, v


@pytest.mark.parametrize("dissipation", [1.0, 0.8, 0.0, None])
def test_order_two(dissipation: float | None) -> None:
    """Error of a damped oscillator: a quarter with half the step."""
    c, duration = 0.4, 2.0
    damped = math.sqrt(OMEGA**2 - c**2 / 4)
    exact = math.exp(-c / 2 * duration) * (
        math.cos(damped * duration) + c / 2 / damped * math.sin(damped * duration)
    )

    def error(step: float) -> float:
        if dissipation is None:
            rule = Scheme.energy_momentum(step, c)
        else:
            rule = Scheme.generalised_alpha(step, dissipation, c)
        return abs(oscillated(rule, duration, 1.0, 0.0)[0] - exact)

    assert error(1e-3) / error(5e-4) == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize("dissipation", [1.0, 0.8, 0.3])
def test_dissipation_of_what_is_too_fast(dissipation: float) -> None:
    """The eigenvalues of a step tend to ρ∞ for ω h → ∞ (Chung and Hulbert, 1993, Eq. 19)."""
    rule = Scheme.generalised_alpha(1e6, dissipation)
    columns = []
    for u, v, a in np.eye(3):  # of state (u, v h, a h²)
        u, v, a = u, v / rule.step, a / rule.step**2
        begun = rule.begin(u, v, a)
        # m = 1 and f = ω² u, which need not balance at the begin
        new = rule.spring * begun.u - begun.g - rule.carried * OMEGA**2 * u
        new /= rule.spring + OMEGA**2
        state = new, rule.velocity(begun, new), rule.acceleration(begun, new)
        columns.append(np.array(state) * [1, rule.step, rule.step**2])
    radius = np.abs(np.linalg.eigvals(np.array(columns).T)).max()
    assert radius == pytest.approx(dissipation, abs=1e-3)


def test_energy_is_kept() -> None:
    u, v = oscillated(Scheme.energy_momentum(0.1), 500.0, 1.0, 0.0)
    assert v**2 / 2 + OMEGA**2 * u**2 / 2 == pytest.approx(OMEGA**2 / 2, rel=1e-11)


def sheared(cell_type: str) -> Array:
    """Corners of one cell, stretched and sheared, not moved off its edges: (1, n, d)."""
    corners = np.array(CORNERS[cell_type], dtype=np.float64)
    d = corners.shape[1]
    return (corners @ (np.eye(d) + 0.3 * np.triu(np.ones((d, d)), 1)) * 2.0)[None]


@pytest.mark.parametrize("cell_type", ["triangle", "quad", "tetra", "hexahedron"])
@pytest.mark.parametrize("quadratic", [False, True])
@pytest.mark.parametrize("lumped", [False, True])
def test_mass_of_cells(cell_type: str, quadratic: bool, lumped: bool) -> None:
    """Mass ρ V, and consistent ones have ∫ ρ x x dV by the map from the reference cell."""
    corners = sheared(cell_type)
    name = NAMES[cell_type] if quadratic else cell_type
    (block,) = mass_blocks(name, corners, np.array([3.0]), lumped)
    d = corners.shape[2]
    is_simplex = corners.shape[1] == d + 1
    mass = 3.0 * 2**d / (math.factorial(d) if is_simplex else 1)
    assert block.sum() == pytest.approx(mass, rel=1e-13)
    assert np.diag(block).min() > 0
    assert (block == np.diag(np.diag(block))).all() == lumped
    if lumped:
        return
    at = points_of(NAMES[cell_type])[: len(block)]  # ξ in the order of the points
    # ∫ ξ_i ξ_j over the reference cell: 1/3, 1/4; of simplices 2/(d+2)!, 1/(d+2)!
    diagonal, other = (2.0, 1.0) if is_simplex else (1 / 3, 1 / 4)
    scale = 1 / math.factorial(d + 2) if is_simplex else 1.0
    moments = scale * (other + (diagonal - other) * np.eye(d)) * 3.0 * 2**d
    assert at.T @ block @ at == pytest.approx(moments, rel=1e-12)


def test_mass_of_a_general_hexahedron() -> None:
    """Sums of a cell with skew faces: its volume by 6 tetrahedra, whose faces are its own.

    A pyramid's top of side 1 over a base of side 2: V = h/3 (4 + 2 + 1).
    """
    corners = np.array(CORNERS["hexahedron"], dtype=np.float64)
    corners[:4, :2] = 2 * corners[:4, :2] - 0.5
    block = mass_blocks("hexahedron", corners[None], np.array([1.0]))
    assert block.sum() == pytest.approx(7 / 3, rel=1e-13)


def test_mass_of_a_body_of_quadratic_cells() -> None:
    """Two quads of 1 × 1: rows of Simpson's weights, m/36 (1, 4, 16) each."""
    coordinates = np.array([[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]], dtype=np.float64)
    cells = np.array([[0, 1, 4, 3], [1, 2, 5, 4]])
    points = PointsBetween.of(cells, "quad", 6)
    for lumped in (False, True):
        matrix = mass_matrix(coordinates, cells, "quad", np.array([1.0, 2.0]), points, lumped)
        rows = np.asarray(matrix.sum(axis=1)).ravel()
        assert rows[:6] * 36 == pytest.approx([1, 3, 2, 1, 3, 2], rel=1e-12)
        assert rows.sum() == pytest.approx(3.0, rel=1e-13)


def test_densities() -> None:
    steel = {"young_modulus": 2e11, "poisson_ratio": 0.3, "density": 7850.0}
    found = densities_of_cells(material_of(steel), None, 2)
    assert found.tolist() == [7850.0, 7850.0]
    light = NeoHookean(young_modulus=1.0, poisson_ratio=0.3, density=1.0, group="light")
    heavy = NeoHookean(young_modulus=1.0, poisson_ratio=0.3, group="heavy")
    with pytest.raises(InputError, match=r"key 'material\.1\.density': missing, expected kg/m³"):
        densities_of_cells((light, heavy), np.array([0, 1]), 2)
    with pytest.raises(ValueError, match="density"):
        material_of(steel | {"density": 0.0})


def test_histories() -> None:
    assert [LoadOverTime.of(read_history("ramp=2")).factor(t) for t in (0, 1, 3)] == [0, 0.5, 1]
    assert LoadOverTime.of("held").factor(0.0) == 1.0
    let_go = LoadOverTime.of(read_history("let_go"))
    assert let_go.begins_loaded
    assert let_go.factor(0.0) == 0.0
    times = np.linspace(0, 50, 2001)
    band = read_history("random=2")
    factors = np.array([LoadOverTime.of(band, 5, 3).factor(t) for t in times])
    again, other = (LoadOverTime.of(band, 5, n).factor(1.7) for n in (3, 4))
    assert again == LoadOverTime.of(band, 5, 3).factor(1.7) != other
    assert factors[0] == 0
    assert np.abs(factors).max() <= 1
    # Waves of at most 2 Hz and 8 weights: |s'| ≤ 2 π 2 Σ|w| = 4π.
    assert np.abs(np.diff(factors)).max() <= 4 * np.pi * times[1]
    for text in ("held=1", "ramp", "ramp=0", "random=x", "thrown"):
        with pytest.raises(InputError, match="expected held, let_go, ramp=SECONDS"):
            read_history(text)


def test_settings() -> None:
    given: dict[str, Any] = {"step": 0.1, "duration": 1.05, "every": 4}
    settings = validate(TimeSettings, given, "case")
    assert (settings.steps, settings.frames) == (11, (0, 4, 8, 11))
    assert TimeSettings(step=0.1, duration=0.3).steps == 3
    drawn = validate(TimeSettings, {**given, "load": {"random": {"frequency": 3}}}, "case")
    assert TimeSettings.model_validate(drawn.model_dump(mode="json")) == drawn
    for wrong, message in (
        ({"step": 0}, "key 'step' = 0"),
        ({"duration": 0.05}, "duration = 0.05 s: expected at least one step = 0.1 s"),
        ({"dissipation": 1.2}, "key 'dissipation' = 1.2"),
        ({"load": "thrown"}, "key 'load' = 'thrown': expected held, let_go, {ramp: seconds}"),
        ({"damping": {"stiff": 1}}, "unknown key 'damping.stiff'"),
    ):
        with pytest.raises(InputError) as caught:
            validate(TimeSettings, {**given, **wrong}, "case")
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)
