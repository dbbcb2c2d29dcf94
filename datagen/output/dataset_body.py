"""The body of a dataset: its mesh, its supports, and where loads act."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.units import Units
from shared_schema.dataset_reader import DatasetReader
from shared_schema.layout import Arrays


class DatasetBody:
    """What every dataset says of its body, with samples or without.

    Parameters
    ----------
    reader : DatasetReader
    arrays : mapping of str to array
        Those of one of its shards.

    Attributes
    ----------
    manifest : Manifest
    units : Units
        Labels of the units of the case.
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
    cell_type : str
        meshio's name.
    clamped, loadable : array of bool, (n_nodes,)
    fibres : array, (n_cells, families, d), or None
        Directions of fibres, if a material has some.
    """

    def __init__(self, reader: DatasetReader, arrays: Arrays) -> None:
        self.manifest = reader.manifest
        self.units = Units.of_case(self.manifest.case)
        self.coordinates: NDArray[np.float64] = arrays["mesh/coordinates"]
        self.cells: NDArray[np.int64] = arrays["mesh/cells"]
        self.clamped: NDArray[np.bool_] = arrays["mesh/clamped"]
        self.loadable: NDArray[np.bool_] = arrays["mesh/loadable"]
        self.fibres: NDArray[np.float64] | None = arrays.get("mesh/fibres")
        self.cell_type = reader.cell_type
