"""Loads that act between the nodes of quadratic elements: closed forms, balances, tangents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from shared_schema.common.bodies.cells import outward_facets
from shared_schema.common.bodies.distributed_loads import area_vectors, nodal_volumes
from shared_schema.common.bodies.following_loads import PressedSurface
from shared_schema.materials import NeoHookean
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.certify.full_certificate import certify
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.equilibrium.stresses import cell_stresses, reactions
from surrogate.mechanics.solids.deformation import completed, stress
from surrogate.mechanics.statics.load import Load
from tests.surrogate.mechanics.bodies import MATERIAL, box

Array = np.ndarray
BODIES = (
    *((cell_type, False) for cell_type in ("triangle", "quad", "tetra", "hexahedron")),
    *((cell_type, True) for cell_type in ("triangle", "tetra")),
)
RUBBER = NeoHookean(young_modulus=500, poisson_ratio=0.4999)
STRETCHES = np.array([1.2, 0.9, 1.05])
PRESSURE = 3.0  # Pa


def body_of(cell_type: str, whole: bool, sliding: bool = False) -> Geometry:
    """The box, clamped or sliding along the planes through the origin, with moved inner nodes."""
    geometry = replace(box(cell_type), mean_dilation=whole, has_points_between=True)
    x = geometry.coordinates
    inside = ((x > 0) & (x < x.max(axis=0))).all(axis=1)
    moved = x + 0.08 * inside[:, None] * np.random.default_rng(0).uniform(-1, 1, x.shape)
    held = x == 0 if sliding else geometry.held
    return replace(geometry, coordinates=moved, single=held, clamped=np.asarray(held.all(axis=1)))


def load_of(geometry: Geometry, forces: Array) -> Array:
    """Forces on all points, as a load on what is free."""
    points = geometry.points_between
    load = np.concatenate([points.on_nodes(forces), forces[points.nodes :]])
    return np.asarray(load * geometry.free_at_points)


def positions(geometry: Geometry) -> Array:
    return np.asarray(geometry.points_between.interpolation @ geometry.coordinates)


def faces(geometry: Geometry) -> list[Array]:
    """Facets of the faces that face along each axis, seen from outside, with all points."""
    x, points = geometry.coordinates, geometry.points_between
    facets = outward_facets(x, geometry.cells, geometry.cell_type)
    ends = [facets[(x[facets, axis] == x[:, axis].max()).all(axis=1)] for axis in range(x.shape[1])]
    return [points.facets(some) for some in ends]


def traction_of(geometry: Geometry, p: Array) -> Array:
    """Forces P N of the stress P on the faces."""
    areas = [area_vectors(positions(geometry), some) for some in faces(geometry)]
    return np.asarray(sum(areas) @ p.T)


def loads_on(geometry: Geometry) -> tuple[Array, FollowingLoads]:
    """A shear traction at the end, a body force, and a pressure on the upper face."""
    d, x = geometry.dimension, positions(geometry)
    end, top = faces(geometry)[:2]
    shear, weight = np.zeros(d), np.zeros(d)
    shear[[0, 1]], weight[d - 1] = (3.0, 5.0), -6.0
    forces = area_vectors(x, end)[:, :1] * shear
    forces += np.outer(nodal_volumes(x, geometry.points_between.cells), weight)
    values = np.array([[PRESSURE]])
    units, points = [PressedSurface(top)], geometry.points_between
    pressure = FollowingLoads.on(geometry.coordinates, units, values, points)
    return load_of(geometry, forces), pressure


@pytest.mark.parametrize(
    ("cell_type", "whole", "material"),
    [*((*body, MATERIAL) for body in BODIES), *((*body, RUBBER) for body in BODIES if body[1])],
)
def test_patch_under_tractions(cell_type: str, whole: bool, material: NeoHookean) -> None:
    """Tractions P(F) N on flat faces have the displacement (F − 1) x, on any mesh."""
    geometry = body_of(cell_type, whole, sliding=True)
    d = geometry.dimension
    stretches = STRETCHES[:d].copy()
    if material is RUBBER:
        stretches[-1] = 1 / stretches[:-1].prod()  # hardly changes its volume
    f = torch.from_numpy(np.diag(stretches))[:, :, None, None, None]
    p = stress(completed(f), material)[:d, :d, 0, 0, 0].numpy()
    load = load_of(geometry, traction_of(geometry, p))
    body = Equilibrium(geometry, material, on_points=True)
    expected = geometry.coordinates * (stretches - 1)
    found = correct(body, load, np.zeros_like(expected)).displacement
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(("cell_type", "whole"), BODIES)
def test_patch_under_pressure(cell_type: str, whole: bool) -> None:
    """The pressure p that follows has P = −p J F⁻ᵀ: all sides shrink alike."""
    geometry = body_of(cell_type, whole, sliding=True)
    d, stretch = geometry.dimension, 0.95
    f = torch.from_numpy(stretch * np.eye(d))[:, :, None, None, None]
    p = -float(stress(completed(f), MATERIAL)[0, 0]) / stretch ** (d - 1)
    values = np.full((1, d), p)
    units, points = [PressedSurface(facets) for facets in faces(geometry)], geometry.points_between
    pressure = FollowingLoads.on(geometry.coordinates, units, values, points)
    body = Equilibrium(geometry, MATERIAL, on_points=True).under(pressure)
    expected, nothing = (stretch - 1) * geometry.coordinates, np.zeros_like(geometry.coordinates)
    found = correct(body, nothing, nothing).displacement
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("cell_type", ["triangle", "quad", "tetra", "hexahedron"])
def test_column_under_its_weight(cell_type: str) -> None:
    """At ν = 0, u = b (L x − x² / 2) / E of a small body force b is exact at all points."""
    geometry = replace(box(cell_type), has_points_between=True)
    x, weight = positions(geometry), 1e-4
    forces = np.zeros_like(x)
    forces[:, 0] = weight * nodal_volumes(x, geometry.points_between.cells)
    body = Equilibrium(geometry, NeoHookean(young_modulus=500, poisson_ratio=0), on_points=True)
    load = load_of(geometry, forces)
    found = body.linear_response(body.forces_at_points(load[None]))[0]
    expected = weight * (2 * x[:, 0] - x[:, 0] ** 2 / 2) / 500
    np.testing.assert_allclose(found[:, 0], expected, rtol=0, atol=1e-12 * expected.max())
    assert np.abs(found[:, 1:]).max() < 1e-12 * expected.max()
    at_corners = body.linear_response(body.forces_at_points(load[None, : body.nodes]))[0]
    assert np.abs(at_corners[:, 0] - expected).max() > 0.01 * expected.max()


@pytest.mark.parametrize(("cell_type", "whole"), BODIES)
def test_correction_and_certificate(cell_type: str, whole: bool) -> None:
    """Under all loads at once: residuals, the points between, the error of a wrong prediction."""
    geometry = body_of(cell_type, whole)
    load, pressure = loads_on(geometry)
    body = Equilibrium(geometry, MATERIAL, on_points=True).under(pressure)
    f, nothing = body.forces_at_points(load[None]), np.zeros_like(geometry.coordinates)
    u = correct(body, load, nothing).displacement
    at_points = body.at_points(u[None], f)
    largest = np.abs(body.external(at_points, f)).max()
    assert np.abs(body.out_of_balance(at_points, f)).max() < 1e-7 * largest
    wrong = u + 1e-3 * np.sin(5 * geometry.coordinates) * geometry.free
    certificate = certify(body, load, wrong)
    assert certificate.settled
    error = certificate.error - (wrong - u)
    assert np.linalg.norm(error) < 0.01 * np.linalg.norm(wrong - u)

    acting = body.external(at_points, f)
    bearing = body.forces_at_nodes(reactions(body.solid, body.geometry, at_points, acting))
    all_forces = load[: body.nodes].sum(axis=0) + pressure.forces(at_points)[0].sum(axis=0)
    np.testing.assert_allclose(bearing[0].sum(axis=0), -all_forces, atol=1e-6 * largest)


@pytest.mark.parametrize(("cell_type", "whole"), BODIES)
def test_the_tangent_is_that_of_the_forces(cell_type: str, whole: bool) -> None:
    """Newton's step answers the change of the out-of-balance forces, by differences."""
    geometry = body_of(cell_type, whole)
    pressure = loads_on(geometry)[1].scaled(10)
    body = Equilibrium(geometry, MATERIAL, on_points=True).under(pressure)
    u = 0.0005 * np.sin(3 * body.geometry.coordinates)[None] * body.free
    direction, small = np.random.default_rng(0).normal(size=u.shape) * body.free, 1e-6
    change = [body.out_of_balance(u + sign * small * direction, 0 * u) for sign in (1, -1)]
    step, _ = body.newton_step(u, (change[0] - change[1]) / (2 * small))
    np.testing.assert_allclose(-step, direction, atol=1e-5)


@pytest.mark.parametrize("by_corners", [False, True])
def test_pressures_of_samples(by_corners: bool) -> None:
    """Those of earlier datasets act on the facets of corners, others on all points of these."""
    plain = body_of("hexahedron", False)
    points, top = plain.points_between, faces(plain)[1]
    geometry = replace(plain, pressed=top[:, :4], pressed_by_corners=by_corners)
    (surface,) = geometry.surfaces
    assert surface.shape[1] == (4 if by_corners else 9)
    load = loads_on(plain)[1].load[0] * geometry.free_at_points
    beside = np.flatnonzero(geometry.loadable & (geometry.coordinates[:, 1] == 0))[-1]
    load[beside] = 2.0
    given = load[: points.nodes] if by_corners else load
    both = Load.of_samples(geometry, given[None])
    dead, found = both.dead, both.following
    assert found is not None
    np.testing.assert_allclose(found.amplitudes, PRESSURE, rtol=1e-12)
    assert np.flatnonzero(dead[0].any(axis=1)).tolist() == [beside]
    assert (found.points is None) == by_corners


def test_stresses_of_a_given_displacement_know_the_load() -> None:
    """Points between move under their own forces: a column under its weight, ν = 0."""
    geometry = replace(box("triangle"), has_points_between=True)
    x, weight = positions(geometry), 0.5
    forces = np.zeros_like(x)
    forces[:, 0] = weight * nodal_volumes(x, geometry.points_between.cells)
    material = NeoHookean(young_modulus=500, poisson_ratio=0)
    body, load = Equilibrium(geometry, material, on_points=True), load_of(geometry, forces)
    u = correct(body, load, np.zeros_like(geometry.coordinates)).displacement[None]
    found = {}
    for name, given in {"all": load, "nodes": load[: body.nodes]}.items():
        at_points = body.at_points(u, body.forces_at_points(given[None]))
        found[name] = cell_stresses(body.solid, body.geometry, at_points)["first_piola"]
    expected = weight * (2 - x[body.geometry.cells[:, :3], 0].mean(axis=1))
    np.testing.assert_allclose(found["all"][0, :, 0, 0], expected, atol=0.002)
    assert np.abs(found["nodes"][0, :, 0, 0] - expected).max() > 0.01
