from __future__ import annotations

import numpy as np
import pytest

from shared_schema.common.bodies.nodal_forces import PointLoad, nodal_forces
from shared_schema.common.errors import InputError

COORDINATES = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [0.0, 1.0]])
CLAMPED = np.array([True, False, False, True])


def test_parse() -> None:
    assert PointLoad.parse("4,1:0,-2.5", 2) == PointLoad((4.0, 1.0), (0.0, -2.5))
    assert PointLoad.parse(" 4 , 1e0 ,.5: 1,2,-3 ", 3) == PointLoad((4, 1, 0.5), (1, 2, -3))


@pytest.mark.parametrize(
    "text",
    ["", "4,1", "4,1:", "4,1:2", "4:1,2", "4,1:1,2:3,4", "4,1,0:1,2,3", "4;1:1,2", "a,b:c,d", ":"],
)
def test_wrong_form(text: str) -> None:
    with pytest.raises(InputError, match="expected X,Y:FX,FY") as error:
        PointLoad.parse(text, 2)
    assert f"'{text}'" in str(error.value)


def test_plane_load_in_space() -> None:
    with pytest.raises(InputError, match="expected X,Y,Z:FX,FY,FZ"):
        PointLoad.parse("4,1:0,1", 3)


@pytest.mark.parametrize(
    "text", ["4,1:nan,0", "4,1:0,inf", "-inf,1:0,1", "4,nan:0,1", "4,1:1e999,0"]
)
def test_not_finite(text: str) -> None:
    with pytest.raises(InputError, match="finite"):
        PointLoad.parse(text, 2)


def test_loads_at_one_node_add_up() -> None:
    forces = nodal_forces(["4,1:0.5,-2", "4,0:1,0", "4,1:0.25,1"], COORDINATES, CLAMPED)
    assert forces.tolist() == [[0, 0], [1, 0], [0.75, -1], [0, 0]]


def test_no_load_is_no_force() -> None:
    assert not nodal_forces([], COORDINATES, CLAMPED).any()


def test_tolerance_is_a_ten_thousandth_of_the_size() -> None:
    # size 4 m, tolerance 4e-4 m
    assert nodal_forces(["4.0003,1:0,1"], COORDINATES, CLAMPED)[2].tolist() == [0, 1]
    with pytest.raises(InputError, match="no node stands there, the nearest is at 4,1"):
        nodal_forces(["4.0005,1:0,1"], COORDINATES, CLAMPED)


def test_clamped_node() -> None:
    with pytest.raises(InputError, match="'0,1:0,1': the node is clamped"):
        nodal_forces(["4,1:0,1", "0,1:0,1"], COORDINATES, CLAMPED)


def test_several_nodes_at_one_place() -> None:
    """Two blocks side by side that are not joined: the force would act on one of them."""
    x = np.vstack((COORDINATES, COORDINATES + np.array([4, 0])))
    free = np.zeros(8, dtype=bool)
    with pytest.raises(InputError, match=r"nodes 2, 7 \(from 0\) stand there, where parts of the"):
        nodal_forces(["4,1:0,1"], x, free)
    assert nodal_forces(["8,1:0,1"], x, free)[6].tolist() == [0, 1]
