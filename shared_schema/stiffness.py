"""The stiffness of the undeformed body: a sparse matrix in a file of its own.

Degrees of freedom are numbered node by node, node · d + component; no supports are applied.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.units import SI, Units
from shared_schema.shard import read_shard, write_shard

STIFFNESS_FILE = "stiffness.h5"
ASYMMETRY = 1e-9  # allowed difference of mirrored entries, relative to the largest entry


@dataclass(frozen=True)
class Stiffness:
    """∂f_int/∂u at u = 0 in compressed sparse rows, columns ascending in every row.

    Attributes
    ----------
    data : array, (n_entries,)
        Entries in N/m.
    indices : array of int, (n_entries,)
        Column of each entry.
    indptr : array of int, (n_dofs + 1,)
        Start of each row in the entries, and the end of the last row.
    """

    data: NDArray[np.float64]
    indices: NDArray[np.int64]
    indptr: NDArray[np.int64]


def write_stiffness(
    folder: Path, stiffness: Stiffness, case_digest: str, cell_type: str, units: Units = SI
) -> str:
    """Write the stiffness into a dataset's folder; return the SHA-256 of the file."""
    arrays = {
        "stiffness/data": stiffness.data,
        "stiffness/indices": stiffness.indices,
        "stiffness/indptr": stiffness.indptr,
    }
    path = folder / STIFFNESS_FILE
    return write_shard(path, "stiffness", arrays, case_digest, cell_type, units)


def read_stiffness(folder: Path) -> Stiffness:
    """Read the stiffness of a dataset that has one; InputError if it is damaged."""
    arrays = read_shard(folder / STIFFNESS_FILE, "stiffness")
    return Stiffness(
        arrays["stiffness/data"], arrays["stiffness/indices"], arrays["stiffness/indptr"]
    )


def stiffness_problems(stiffness: Stiffness, dofs: int) -> list[str]:
    """List what is wrong with a stiffness matrix of `dofs` degrees of freedom."""
    starts, count = stiffness.indptr, len(stiffness.data)
    if len(starts) != dofs + 1 or starts[0] != 0 or starts[-1] != count:
        return [f"dataset 'stiffness/indptr' is not that of {dofs} rows and {count} entries"]
    lengths, columns = np.diff(starts), stiffness.indices
    if count and (lengths.min() < 0 or columns.min() < 0 or columns.max() >= dofs):
        return [f"dataset 'stiffness/indices' names a column outside 0 … {dofs - 1}"]
    rows = np.repeat(np.arange(dofs), lengths)
    place, mirrored = rows * dofs + columns, columns * dofs + rows
    if np.any(np.diff(place) <= 0):
        return ["dataset 'stiffness/indices' is not ascending in every row"]
    order = np.argsort(mirrored)
    tolerance = ASYMMETRY * np.abs(stiffness.data).max(initial=0.0)
    if not np.array_equal(mirrored[order], place) or np.any(
        np.abs(stiffness.data[order] - stiffness.data) > tolerance
    ):
        return ["dataset 'stiffness/data' is not symmetric"]
    return []
