"""Random load cases of a run: those of its training, or of another family around them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError
from surrogate.learning.data.case_loads import Loads, families_of, trained_loads
from surrogate.learning.data.load_families import TRAINED, random_loads
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.mechanics import FollowerPressure

Array = NDArray[np.float64]


def loads_of(surrogate: Surrogate, family: str = TRAINED) -> Loads:
    """Random dead loads of a run's training, or of another family; InputError as `drawn_loads`."""
    data = surrogate.description.data
    limit, numbers = data.info.force.max_abs, data.load_numbers
    return trained_loads(surrogate.geometry, data.case, limit, numbers, family)


def drawn_loads(
    surrogate: Surrogate, count: int, random: np.random.Generator, family: str = TRAINED
) -> Array:
    """Draw load cases.

    Body forces and patches of traction are drawn as the case has them. The pressures of a case are
    drawn from its ranges, and the forces beside them from its family of random nodes: the forces of
    its samples hold both.

    Parameters
    ----------
    surrogate : Surrogate
    count : int
        Number of load cases.
    random : Generator
    family : str
        Such as ``trained`` or ``loads=1-8,reach=2,places=free``
        (`surrogate.learning.data.load_families`).

    Returns
    -------
    array, (count, n_nodes, d)
        Nodal forces in N, with those of pressures on the undeformed body.

    Raises
    ------
    InputError
        If the family is wrong, or a case with pressures has other loads than random nodes of a
        symmetric range beside them.
    """
    body, data = surrogate.geometry, surrogate.description.data
    if not body.surfaces:
        return loads_of(surrogate, family).draw(count, random)
    families = families_of(data.case)
    ranges = [given["range"] for given in families if given["family"] == "pressure"]
    forces = np.zeros((count, *body.coordinates.shape))
    for given in families:
        low, high = given["range"]
        if given["family"] == "random_nodes" and low == -high:
            fewest, most = given["count"]
            limits = (high,) * body.dimension
            forces += random_loads(family, body, limits, (fewest, most)).draw(count, random)
        elif given["family"] != "pressure":
            raise InputError(
                f"load family '{given['family']}', range {low} to {high}: expected random_nodes of "
                "a symmetric range, and pressure"
            )
    low, high = np.transpose(ranges)
    pressures = random.uniform(low, high, (count, len(ranges)))
    pressed = FollowerPressure.on(body.coordinates, body.surfaces, pressures, body.pressed_points)
    at_nodes = pressed.load[:, : len(body.coordinates)]
    return np.asarray(forces + np.where(body.held, 0, at_nodes))
