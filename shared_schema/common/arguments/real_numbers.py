"""Arrays of real numbers, from what a caller in Python gives as one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError, first_line


def real_numbers(value: Any, name: str) -> NDArray[np.float64]:
    """Return real numbers in double precision, of an array, a tensor, or nested sequences.

    The array is a new one: what is done with it does not change the caller's numbers, nor does the
    caller change it later.

    Raises
    ------
    InputError
        If they are complex, masked, sparse, or no numbers.
    """
    if hasattr(value, "detach"):  # a tensor, which may require gradients
        if value.is_meta or "strided" not in str(value.layout):
            raise InputError(f"{name} are a tensor without all its numbers, expected a dense one")
        value = value.detach().cpu().resolve_conj().resolve_neg()
        value = (value if value.is_complex() else value.double()).numpy()
    if np.ma.isMaskedArray(value):
        raise InputError(f"{name} are a masked array, expected an array without a mask")
    try:
        found = np.asarray(value)
        if found.dtype.kind == "O":
            found = found.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} are no array of numbers ({first_line(error)})") from None
    if found.dtype.kind not in "biuf":
        kind = "complex" if found.dtype.kind == "c" else f"of type {found.dtype}"
        raise InputError(f"{name} are {kind}, expected real numbers")
    return np.array(found, np.float64)
