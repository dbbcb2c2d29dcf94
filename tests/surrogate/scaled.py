"""Trained networks of bodies of another size and stiffness, whose answers differ in units only."""

from __future__ import annotations

from functools import cache
from typing import Any

from shared_schema.manifest import ComponentStatistics
from surrogate.learning.data.load_range import LoadRange
from surrogate.learning.inference.surrogate import Surrogate, make_surrogate
from surrogate.learning.runs.description import RunDescription
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.shelf import find_run

LENGTHS = {"geometry.coordinates", "displacement_rms", "displacement_scale"}
MODULI = {"young_modulus", "shear_modulus", "bulk_modulus"}


@cache
def scaled(name: str, length: float = 1.0, modulus: float = 1.0) -> tuple[Surrogate, float]:
    """Return a shipped network with all its lengths and stiffnesses multiplied.

    Returns
    -------
    surrogate : Surrogate
    force : float
        What all forces are multiplied by: that of stiffness times length^(d-1).
    """
    folder = RunFolder(find_run(name))
    description, tensors = folder.description(), folder.read_tensors()
    force = modulus * length ** (description.data.dimension - 1)
    for key, tensor in tensors.items():
        if key in LENGTHS:
            tensors[key] = tensor * length
        elif key == "force_scale":
            tensors[key] = tensor * force
    return make_surrogate(tensors, _described(description, length, modulus, force)), force


def _described(
    description: RunDescription, length: float, modulus: float, force: float
) -> RunDescription:
    data = description.data
    info = data.info.model_copy(
        update={
            "force": _times(data.info.force, force),
            "displacement": _times(data.info.displacement, length),
        }
    )
    loads = data.loads
    if loads is not None:
        resultant = tuple(force * value for value in loads.resultant)
        loads = LoadRange(fewest=loads.fewest, most=loads.most, resultant=resultant)
    solver = dict(data.case["solver"])
    if "tolerance" in solver:
        solver["tolerance"] *= force
    case = {
        **data.case,
        "material": _stiffened(data.case["material"], modulus),
        "solver": solver,
    }
    update = {"info": info, "loads": loads, "case": case}
    return description.model_copy(update={"data": data.model_copy(update=update)})


def _times(of: ComponentStatistics, factor: float) -> ComponentStatistics:
    return ComponentStatistics(
        mean=tuple(factor * value for value in of.mean),
        std=tuple(factor * value for value in of.std),
        max_abs=tuple(factor * value for value in of.max_abs),
    )


def _stiffened(material: Any, modulus: float) -> Any:
    if isinstance(material, list):
        return [_stiffened(each, modulus) for each in material]
    return {
        key: modulus * value if key in MODULI and value is not None else value
        for key, value in material.items()
    }
