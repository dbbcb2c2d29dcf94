"""Meshes of boxes against counts and positions known beforehand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from pydantic import ValidationError

from datagen.mesh.box import Box
from datagen.mesh.distributed_mesh import make_mesh


@pytest.mark.parametrize(
    ("elements", "upper", "cell_type"),
    [((15, 3), (4.0, 1.0), "quad"), ((5, 3, 2), (4.0, 1.0, 1.0), "hexahedron")],
)
def test_box(elements: tuple[int, ...], upper: tuple[float, ...], cell_type: str) -> None:
    """∏(n + 1) nodes, ∏ n cells, evenly spaced, each cell of the same positive volume."""
    mesh = make_mesh(Box(lower=(0.0,) * len(upper), upper=upper, elements=elements), MPI.COMM_SELF)
    assert mesh.cell_type == cell_type
    assert len(mesh.coordinates) == np.prod(np.add(elements, 1))
    assert len(mesh.cells) == np.prod(elements)
    for axis, (count, length) in enumerate(zip(elements, upper, strict=True)):
        lines = np.unique(mesh.coordinates[:, axis].round(9))
        assert lines == pytest.approx(np.linspace(0, length, count + 1), abs=1e-9)
    corners = mesh.coordinates[mesh.cells]
    size = np.divide(upper, elements)
    assert np.ptp(corners, axis=1) == pytest.approx(np.tile(size, (len(mesh.cells), 1)))


@pytest.mark.parametrize(("elements", "upper"), [((3, 2), (3.0, 2.0)), ((2, 2, 2), (1.0,) * 3)])
def test_cells_are_in_vtk_order(elements: tuple[int, ...], upper: tuple[float, ...]) -> None:
    """VTK order goes around the bottom face, then the top: neighbours differ along one axis."""
    mesh = make_mesh(Box(lower=(0.0,) * len(upper), upper=upper, elements=elements), MPI.COMM_SELF)
    corners = mesh.coordinates[mesh.cells]
    for face in (corners[:, :4], corners[:, 4:]):
        steps = np.roll(face, -1, axis=1) - face
        assert np.all((np.abs(steps) > 1e-9).sum(axis=2) == 1)
    if len(upper) == 3:
        upward = corners[:, 4:] - corners[:, :4]
        assert np.all((np.abs(upward) > 1e-9).sum(axis=2) == 1)


@pytest.mark.parametrize(
    "wrong",
    [
        {"upper": (4, 0)},
        {"elements": (15, 0)},
        {"elements": (15, 3, 2)},
        {"lower": (0,)},
        {"thickness": 1},
    ],
)
def test_invalid_boxes(wrong: dict[str, Any]) -> None:
    right: dict[str, Any] = {"lower": (0, 0), "upper": (4, 1), "elements": (15, 3)}
    Box.model_validate(right)
    with pytest.raises(ValidationError):
        Box.model_validate(right | wrong)
