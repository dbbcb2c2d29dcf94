"""Forces at nodes, also as a command gives them."""

from __future__ import annotations

import numpy as np
import pytest

from shared_schema.common.bodies.nodal_forces import (
    PointLoad,
    nodal_forces,
    scatter_forces,
    sum_per_node,
)
from shared_schema.common.errors import InputError

COORDINATES = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [0.0, 1.0]])
CLAMPED = np.array([True, False, False, True])


def test_forces_are_scattered_and_padding_is_not() -> None:
    nodes, loads = np.array([[2, -1], [0, 1]]), np.arange(8.0).reshape(2, 2, 2)
    force = scatter_forces(nodes, loads, 3)
    assert force.tolist() == [[[0, 0], [0, 0], [0, 1]], [[4, 5], [6, 7], [0, 0]]]


def test_forces_on_one_node_add_up() -> None:
    """Node 1 twice in the first sample, once in the second; 2 + 3 = 5 and 1 + 7 = 8."""
    nodes = np.array([[1, 0, 1], [2, 1, -1]])
    loads = np.array([[[2.0, 1.0], [9.0, 9.0], [3.0, 7.0]], [[4.0, 4.0], [6.0, 5.0], [0.0, 0.0]]])
    force = scatter_forces(nodes, loads, 3)
    assert force.tolist() == [[[9, 9], [5, 8], [0, 0]], [[0, 0], [6, 5], [4, 4]]]
    assert force.sum(axis=1).tolist() == loads.sum(axis=1).tolist()


def test_one_load_case_and_none() -> None:
    force = scatter_forces(np.array([1, 1]), np.array([[1.0, 2.0, 3.0], [1.0, 1.0, 1.0]]), 2)
    assert force.tolist() == [[0, 0, 0], [2, 3, 4]]
    assert not scatter_forces(np.array([-1]), np.zeros((1, 2)), 4).any()
    assert scatter_forces(np.zeros((0, 3), dtype=np.int64), np.zeros((0, 3, 2)), 4).shape == (
        0,
        4,
        2,
    )


def test_single_precision_is_summed_in_double() -> None:
    loads = np.array([[1.0], [2.0**-30]], dtype=np.float32)
    force = scatter_forces(np.array([0, 0]), loads, 1)
    assert force.dtype == np.float64
    assert force[0, 0] == 1 + 2.0**-30


def test_every_node_once_in_the_order_of_its_first_force() -> None:
    nodes, forces = sum_per_node(
        np.array([7, 2, 7, 5, 2]), np.array([[1.0, 0], [2, 0], [10, 1], [3, 0], [20, 2]])
    )
    assert nodes.tolist() == [7, 2, 5]
    assert forces.tolist() == [[11, 1], [22, 2], [3, 0]]


@pytest.mark.parametrize("nodes", [[3], [9, 1, 4], []])
def test_distinct_nodes_stay_as_they_are(nodes: list[int]) -> None:
    loads = np.random.default_rng(0).normal(size=(len(nodes), 2))
    found = sum_per_node(np.array(nodes, dtype=np.int64), loads)
    assert found[0].tolist() == nodes
    assert np.array_equal(found[1], loads)


def test_parse() -> None:
    assert PointLoad.parse("4,1:0,-2.5", 2) == PointLoad((4.0, 1.0), (0.0, -2.5))
    assert PointLoad.parse(" 4 , 1e0 ,.5: 1,2,-3 ", 3) == PointLoad((4, 1, 0.5), (1, 2, -3))


@pytest.mark.parametrize(
    "text",
    ["", "4,1", "4,1:", "4,1:2", "4:1,2", "4,1:1,2:3,4", "4,1,0:1,2,3", "4;1:1,2", "a,b:c,d", ":"],
)
def test_wrong_form_of_a_load(text: str) -> None:
    with pytest.raises(InputError, match="expected X,Y:FX,FY") as error:
        PointLoad.parse(text, 2)
    assert f"'{text}'" in str(error.value)


@pytest.mark.parametrize(
    "text", ["4,1:nan,0", "4,1:0,inf", "-inf,1:0,1", "4,nan:0,1", "4,1:1e999,0"]
)
def test_not_finite(text: str) -> None:
    with pytest.raises(InputError, match="finite"):
        PointLoad.parse(text, 2)


def test_tolerance_is_a_ten_thousandth_of_the_size() -> None:
    # size 4 m, tolerance 4e-4 m
    assert nodal_forces(["4.0003,1:0,1"], COORDINATES, CLAMPED)[2].tolist() == [0, 1]
    with pytest.raises(InputError, match="no node stands there, the nearest is at 4,1"):
        nodal_forces(["4.0005,1:0,1"], COORDINATES, CLAMPED)


def test_several_nodes_at_one_place() -> None:
    """Two blocks side by side that are not joined: the force would act on one of them."""
    x = np.vstack((COORDINATES, COORDINATES + np.array([4, 0])))
    free = np.zeros(8, dtype=bool)
    with pytest.raises(InputError, match=r"nodes 2, 7 \(from 0\) stand there, where parts of the"):
        nodal_forces(["4,1:0,1"], x, free)
    assert nodal_forces(["8,1:0,1"], x, free)[6].tolist() == [0, 1]
