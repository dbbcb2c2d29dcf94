"""The check that a run and a dataset are of the same body: mesh, supports and material."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError
from shared_schema.layout import Arrays

ROUNDING = 1e-12  # relative to the largest value of an array
BODY_KEYS = ("mesh", "supports", "material", "element")  # of a case configuration


@dataclass(frozen=True)
class BodyRecord:
    """A body as a run or a dataset holds it.

    Attributes
    ----------
    case : mapping
        Case configuration.
    arrays : mapping of str to array
        Arrays of mesh, supports and grid by name (`Geometry.arrays`), or some of them.
    """

    case: Mapping[str, Any]
    arrays: Arrays


def require_same_body(
    run: BodyRecord, dataset: BodyRecord, refusal: str, keys: Sequence[str] = BODY_KEYS
) -> None:
    """Refuse a dataset of another body than the run's, and name the first difference.

    The case configurations are compared first, then every array that the dataset's body has.

    Parameters
    ----------
    run, dataset : BodyRecord
    refusal : str
        Beginning of the message.
    keys : sequence of str
        Keys of the case configuration that have to agree.

    Raises
    ------
    InputError
        If the bodies differ.
    """
    for key in keys:
        found, expected = dataset.case.get(key), run.case.get(key)
        if found != expected:
            raise InputError(f"{refusal}: {key} = {found!r}, expected {expected!r}")
    name = differing_array(run.arrays, dataset.arrays)
    if name is not None:
        raise InputError(f"{refusal}: the mesh is not that of the dataset, '{name}' differs")


def differing_array(run: Arrays, dataset: Arrays) -> str | None:
    """Name of the dataset's first array that the run does not have with the same values.

    Coordinates may differ by `ROUNDING`, as those of two releases of gmsh do.
    """
    for name, array in dataset.items():
        if name not in run or not _agree(run[name], array):
            return name
    return None


def _agree(some: NDArray[Any], others: NDArray[Any]) -> bool:
    if some.shape != others.shape or not np.issubdtype(others.dtype, np.floating):
        return np.array_equal(some, others)
    return bool(np.allclose(some, others, rtol=0, atol=ROUNDING * np.abs(others).max(initial=0)))
