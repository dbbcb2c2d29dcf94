"""Equilibria of the factory, held against another program on the same meshes: FElupe.

FElupe (https://felupe.readthedocs.io) takes the energy as it is printed, and has its own elements,
assembly and Newton's method.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import felupe
import meshio
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.end_to_end.commands import DATAGEN, execute
from tests.end_to_end.test_contact_by_felupe import paper_energy

Array = NDArray[np.float64]
Loading = Callable[[felupe.FieldContainer, meshio.Mesh], tuple[Any, Any]]  # load and full value
CLOSE = 1e-8  # of the largest displacement
STEPS = 2  # in which FElupe's load grows
REGIONS = {
    "quad": felupe.RegionQuad,
    "tetra": felupe.RegionTetra,
    "hexahedron": felupe.RegionHexahedron,
}
FINGERTIP = "0.1,0,0.016:0,0.01,0.05"
BODY_FORCE, PRESSURE = (0.0, 2000.0, -6000.0), 40.0  # N/m³; Pa
BLOCK = """
SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 2, 1, 1};
Transfinite Curve {:} = 4;
Transfinite Surface {:};
Recombine Surface {:};
Transfinite Volume {1};
Physical Volume("body") = {1};
Physical Surface("root") = {1};
Physical Surface("top") = {6};
"""


def nodal(field: felupe.FieldContainer, solution: meshio.Mesh) -> tuple[Any, Array]:
    """The nodal forces of the factory's file."""
    force = solution.point_data["force"][:, : field[0].dim]
    return felupe.PointLoad(field, np.arange(len(force)), values=force), force


def by_volume(field: felupe.FieldContainer, _: meshio.Mesh) -> tuple[Any, Array]:
    return felupe.SolidBodyForce(field), np.array(BODY_FORCE)


def on_top(field: felupe.FieldContainer, solution: meshio.Mesh) -> tuple[Any, float]:
    """A pressure that follows the face z = 1."""
    mesh = field.region.mesh
    top = np.isclose(mesh.points[:, 2], 1.0)
    region = felupe.RegionHexahedronBoundary(mesh, mask=top)
    boundary = felupe.FieldContainer([felupe.Field(region, dim=3)])
    return felupe.SolidBodyPressure(boundary), PRESSURE


def by_felupe(solution: meshio.Mesh, material: tuple[float, float], loading: Loading) -> Array:
    """Displacement in m of a body of one Neo-Hookean material, held where the factory's is."""
    (block,) = (block for block in solution.cells if block.type in REGIONS)
    d = 2 if block.type == "quad" else 3
    mesh = felupe.Mesh(solution.points[:, :d], block.data.astype(int), block.type)
    kind = felupe.FieldPlaneStrain if d == 2 else felupe.Field
    displacement = kind(REGIONS[block.type](mesh), dim=d)
    field = felupe.FieldContainer([displacement])
    young_modulus, poisson_ratio = material
    mu = young_modulus / 2 / (1 + poisson_ratio)
    lam = 2 * mu * poisson_ratio / (1 - 2 * poisson_ratio)
    solid = felupe.SolidBody(felupe.Hyperelastic(paper_energy, mu=mu, lam=lam), field)
    held = ~solution.point_data["displacement"].any(axis=1)
    bounds = {"held": felupe.Boundary(displacement, mask=held)}
    load, whole = loading(field, solution)
    step = felupe.Step(
        [solid, load],
        ramp={load: [whole * part for part in np.linspace(0, 1, STEPS + 1)[1:]]},
        boundaries=bounds,
    )
    felupe.Job([step]).evaluate(verbose=0, tol=1e-11)
    return np.asarray(displacement.values)


@pytest.mark.parametrize(
    ("case", "words", "material", "loading"),
    [
        ("beam2d", ("--load", "4,1:0,-2.5"), (500, 0.4), nodal),
        ("lshape2d", ("--load", "4.8,2:-1,0.5"), (500, 0.4), nodal),
        (
            "beam3d",
            ("--set", "mesh.elements=[14,5,5]", "--load", "4,1,1:0.2,-0.8,0.4"),
            (500, 0.4),
            nodal,
        ),
        (
            "finger3d",
            ("--set", "element=linear", "--nearest", "--load", FINGERTIP),
            (5e5, 0.49),
            nodal,
        ),
        ("breast3d", ("--body-force", ",".join(map(str, BODY_FORCE))), (800, 0.4), by_volume),
        ("block", ("--load", f"top:{PRESSURE}"), (500, 0.4), on_top),
    ],
)
def test_the_same_equilibrium(
    case: str,
    words: tuple[str, ...],
    material: tuple[float, float],
    loading: Loading,
    tmp_path: Path,
) -> None:
    named: str | Path = case
    if case == "block":
        (tmp_path / "block.geo").write_text(BLOCK)
        named = tmp_path / "block.yaml"
        named.write_text(
            "name: block\n"
            "mesh: {kind: file, path: block.geo}\n"
            "material: {young_modulus: 500, poisson_ratio: 0.4}\n"
            "supports: [{group: root}]\n"
            "load: {family: pressure, region: {group: top}, range: [0, 50]}\n"
            "dataset: {samples: 4}\n"
        )
    out = tmp_path / "solution.vtu"
    tight = ("--set", "solver={relative_tolerance: 1.0e-12}")
    execute(DATAGEN, "solve", named, *words, *tight, "--out", out)
    solution = meshio.read(out)
    expected = by_felupe(solution, material, loading)
    found = solution.point_data["displacement"][:, : expected.shape[1]]
    largest = float(np.abs(expected).max())
    assert largest > 1e-3
    np.testing.assert_allclose(found, expected, rtol=0, atol=CLOSE * largest)


@pytest.mark.slow
@pytest.mark.parametrize("load", ["traction", "pressure"])
def test_quadratic_hexahedra_under_a_distributed_load(load: str, tmp_path: Path) -> None:
    """A dead traction of (4, 0, -6) Pa, and a pressure that follows, on the face z = 1.

    FElupe integrates them on its own quadratic facets.
    """
    (tmp_path / "block.geo").write_text(BLOCK.replace("= 4;", "= 3;"))
    case, file = tmp_path / "block.yaml", tmp_path / "block.vtu"
    case.write_text(
        "name: block\n"
        "mesh: {kind: file, path: block.geo}\n"
        "material: {young_modulus: 500, poisson_ratio: 0.4}\n"
        "element: quadratic\n"
        "supports: [{x: 0}]\n"
        "load: {family: random_node, region: {x: 2}, range: [-1, 1]}\n"
        "solver: {relative_tolerance: 1.0e-12}\n"
        "dataset: {samples: 1, seed: 1}\n"
    )
    acting = "top:8,0,-12" if load == "traction" else f"top:{PRESSURE}"  # 2 m²
    result = execute(DATAGEN, "solve", case, "--load", acting, "--out", file)
    assert result.returncode == 0, result.stderr
    solution = meshio.read(file)
    (block,) = (block for block in solution.cells if block.type == "hexahedron")
    corners = felupe.Mesh(solution.points, block.data.astype(int), "hexahedron")
    mesh = felupe.mesh.convert(
        corners, order=2, calc_points=True, calc_midfaces=True, calc_midvolumes=True
    )
    displacement = felupe.Field(felupe.RegionTriQuadraticHexahedron(mesh), dim=3)
    field = felupe.FieldContainer([displacement])
    mu, lam = 500 / 2.8, 500 * 0.4 / 1.4 / 0.2
    solid = felupe.SolidBody(felupe.Hyperelastic(paper_energy, mu=mu, lam=lam), field)
    top = felupe.RegionTriQuadraticHexahedronBoundary(mesh, mask=np.isclose(mesh.points[:, 2], 1))
    surface = felupe.FieldContainer([felupe.Field(top, dim=3)])
    item: Any = felupe.SolidBodyPressure(surface)
    whole: Any = PRESSURE
    if load == "traction":
        shares = np.zeros(len(mesh.points))  # ∫ N_a dS
        np.add.at(shares, top.mesh.cells.T, np.einsum("aqc,qc->ac", top.h, top.dV))
        whole = np.outer(shares, [4.0, 0.0, -6.0])
        item = felupe.PointLoad(field, np.arange(len(shares)), values=whole)
    bounds = {"held": felupe.Boundary(displacement, fx=0.0)}
    ramp = {item: [whole * part for part in (0.5, 1.0)]}
    felupe.Job([felupe.Step([solid, item], ramp=ramp, boundaries=bounds)]).evaluate(
        verbose=0, tol=1e-11
    )
    expected = np.asarray(displacement.values)[: len(solution.points)]
    found = solution.point_data["displacement"]
    assert np.abs(expected).max() > 0.05
    assert np.abs(found - expected).max() < CLOSE * np.abs(expected).max()
