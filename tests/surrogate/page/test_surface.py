"""What is drawn of a body: numbers of faces, vertices and lines follow from those of a box."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from shared_schema.common.errors import InputError
from surrogate.page.surface import surface_of
from tests.surrogate.mechanics.bodies import box

NX, NY, NZ = 5, 3, 3  # nodes of the box in space


def test_surface_of_hexahedra() -> None:
    geometry = box("hexahedron")
    surface = surface_of(geometry)
    cells = [(NX - 1) * (NY - 1), (NX - 1) * (NZ - 1), (NY - 1) * (NZ - 1)]
    assert len(surface.triangles) == 2 * 2 * sum(cells)
    # each side has its own vertices, as sides meet at right angles
    assert len(surface.vertices) == 2 * (NX * NY + NX * NZ + NY * NZ)
    assert len(surface.features) == 4 * (NX - 1 + NY - 1 + NZ - 1)
    # Euler: V − E + F = 2 for the nodes, lines and faces of a closed surface
    nodes = np.unique(surface.vertices)
    assert len(nodes) == NX * NY * NZ - (NX - 2) * (NY - 2) * (NZ - 2)
    assert len(nodes) - len(surface.lines) + 2 * sum(cells) == 2
    assert len(surface.supports) == 2 * (NY - 1) * (NZ - 1)
    assert geometry.clamped[surface.supports].all()


def test_supports_in_single_components() -> None:
    """A roller along one side of the sheet, beside the clamped one: 6 + 3 edges are marked."""
    geometry = box("quad")
    held = np.repeat(geometry.clamped[:, None], 2, axis=1)
    held[:, 1] |= geometry.coordinates[:, 1] == geometry.coordinates[:, 1].min()
    assert len(surface_of(replace(geometry, single=held)).supports) == 6 + 3


@pytest.mark.parametrize("cell_type", ["hexahedron", "tetra"])
def test_triangles_enclose_the_volume_seen_from_outside(cell_type: str) -> None:
    """The divergence theorem: Σ a · (b × c) / 6 over the triangles is the volume, 2 m³."""
    geometry = box(cell_type)
    surface = surface_of(geometry)
    a, b, c = geometry.coordinates[surface.vertices[surface.triangles]].swapaxes(0, 1)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(2)


@pytest.mark.parametrize("cell_type", ["quad", "triangle"])
def test_whole_body_in_the_plane(cell_type: str) -> None:
    geometry = box(cell_type)
    surface = surface_of(geometry)
    a, b, c = geometry.coordinates[surface.vertices[surface.triangles]].swapaxes(0, 1)
    (px, py), (qx, qy) = (b - a).T, (c - a).T
    assert (px * qy - py * qx).sum() / 2 == pytest.approx(2)  # the area in m²
    assert np.sort(surface.vertices).tolist() == list(range(7 * 4))
    assert len(surface.features) == 2 * (6 + 3)
    assert len(surface.supports) == 3


def test_smooth_surface_shares_its_vertices() -> None:
    """A bent sheet whose faces meet at 10° has one vertex a node on its upper side."""
    geometry = box("hexahedron")
    x, y, z = geometry.coordinates.T
    angle = np.radians(20) * x
    bent = np.stack([(3 - z) * np.sin(angle), y, 3 - (3 - z) * np.cos(angle)], axis=1)
    surface = surface_of(replace(geometry, coordinates=bent))
    assert len(surface.vertices) == 2 * (NX * NY + NX * NZ + NY * NZ)
    assert len(surface.features) == 4 * (NX - 1 + NY - 1 + NZ - 1)


@pytest.mark.parametrize("cell_type", ["quad", "triangle", "hexahedron", "tetra"])
def test_seams_between_two_materials(cell_type: str) -> None:
    """Halves of the box meet at x = 1 m: on 1 m², in the plane on 1 m; one material has none."""
    geometry = box(cell_type)
    assert surface_of(geometry).seams.shape == (0, geometry.dimension)
    beyond = geometry.coordinates[geometry.cells, 0].mean(axis=1) > 1
    corners = geometry.coordinates[
        surface_of(replace(geometry, parts=beyond.astype(np.int64))).seams
    ]
    np.testing.assert_allclose(corners[..., 0], 1)
    sides = np.diff(np.pad(corners, ((0, 0), (0, 0), (0, 3 - geometry.dimension))), axis=1)
    lengths = np.linalg.norm(sides[:, 0], axis=1)
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, -1]), axis=1) / 2
    assert (lengths if geometry.dimension == 2 else areas).sum() == pytest.approx(1)


def test_mesh_without_a_surface_is_refused() -> None:
    geometry = box("quad")
    for without in (
        replace(geometry, cell_type="line"),
        replace(geometry, cells=geometry.cells[:0]),
    ):
        with pytest.raises(InputError, match="expected some of triangle, quad, tetra, hexahedron"):
            surface_of(without)
