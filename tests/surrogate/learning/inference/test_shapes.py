"""Models of a family of shapes: by similarity, a body of s times the size under s times the force
per thickness moves s times as far.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import surrogate
from shared_schema.common.bodies.shape_family import ShapeFamily, design
from shared_schema.common.errors import InputError
from surrogate.command_line import main
from surrogate.learning.inference.surrogate import Surrogate, make_surrogate
from surrogate.mechanics.body.elements_of_case import with_elements
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.statics.body import Body
from surrogate.mechanics.statics.prediction import Series


def with_sizes(geometry: Geometry) -> Geometry:
    """The body with a parameter `size`, the factor on all lengths, and a `shear`."""
    sizes = 1 + 0.5 * design(2)[:, 0]
    shears = 0.1 * design(2)[:, 1]
    x = np.array([s * geometry.coordinates for s in sizes])
    x[..., 0] += shears[:, None] * x[..., 1]
    shapes = ShapeFamily.through({"size": (0.5, 1.5), "shear": (-0.1, 0.1)}, x)
    return replace(geometry, shapes=shapes, parameters=shapes.middle)


@pytest.fixture(scope="module")
def family() -> Surrogate:
    beam = surrogate.load("beam2d_any")
    tensors = {**beam.network.state_dict(), **with_sizes(beam.geometry).tensors()}
    return make_surrogate(tensors, beam.description)


def load_of(model: Surrogate) -> np.ndarray:
    force = np.zeros(model.geometry.coordinates.shape)
    force[model.geometry.tip] = 0.4, -1.2
    return force


def test_a_body_of_another_size_moves_by_similarity(family: Surrogate) -> None:
    force = load_of(family)
    moved = family.correct(force).displacement
    for size in (0.7, 1.4):
        shape = family.of_shape({"size": size})
        assert shape.geometry.coordinates == pytest.approx(size * family.geometry.coordinates)
        found = shape.correct(size * force).displacement
        assert found == pytest.approx(size * moved, abs=1e-9)
        predicted = family.predict(size * force, tolerance=1e-4, parameters={"size": size})
        largest = np.linalg.norm(size * moved, axis=1).max()
        assert np.linalg.norm(predicted - size * moved, axis=1).max() < 1e-4 * largest
        error = shape.certify(size * force, predicted).error
        assert error == pytest.approx(predicted - size * moved, abs=1e-8)


def test_shapes_are_those_of_a_body_and_kept(family: Surrogate) -> None:
    shape = {"size": 0.8, "shear": 0.05}
    body = family.body.of_shape(shape)
    force = load_of(family)
    assert Series(body).predict(force) == pytest.approx(
        family.predict(force, parameters=shape), abs=1e-6
    )
    assert family.of_shape(shape) is family.of_shape(dict(reversed(shape.items())))
    assert isinstance(body, Body)
    assert body.geometry.parameters == pytest.approx([0.8, 0.05])
    solution = family.solve(force, parameters=shape, correct=True)
    assert solution.geometry.coordinates == pytest.approx(body.geometry.coordinates)


def test_wrong_shapes_are_refused(family: Surrogate) -> None:
    for given, said in (
        ({"length": 1.0}, "parameter length=1.0: no such parameter, expected size, shear"),
        ({"size": 0.0}, "parameter size = 0, shear = 0: .* nearly flat|turned over"),
    ):
        with pytest.raises(InputError, match=said):
            family.predict(load_of(family), parameters=given)
    with pytest.raises(InputError, match="parameter size: the body has one shape"):
        surrogate.load("beam2d_any").of_shape({"size": 1.0})


def test_command_refuses_a_parameter_of_one_shape(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["predict", "beam2d_any", "--load", "4,1:0,-1", "--out", str(tmp_path / "p.npz")]
    assert main([*command, "--parameter", "size=1"]) == 2
    assert "--parameter size: the body has one shape" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_cables_keep_their_points_of_the_body(family: Surrogate) -> None:
    """A cable is as long as the body is large, read again with the shape or not."""
    cable = {"cable": [[0.5, 0.5], [2.0, 0.7], [3.5, 0.5]], "tension": [0, 1]}
    case = {**family.body.case, "actuators": {"along": cable}}
    body = Body(with_elements(family.geometry, case, None), case)
    shape = body.of_shape({"size": 1.3}).geometry
    read = with_elements(Geometry.from_tensors(shape.tensors(), shape.cell_type), case, None)
    assert body.geometry.actuators is not None
    for geometry in (shape, read):
        assert geometry.actuators is not None
        assert geometry.actuators.rest == pytest.approx(1.3 * body.geometry.actuators.rest)
