"""Script: write a file of Parquet for each split, with pyarrow; it imports nothing of this project.

    python write_parquet.py FOLDER OUT

FOLDER is that of `datagen.contrib.plaid.exporting`. Displacements of hidden samples, which are NaN
there, are null.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

FIELDS, OF_SHAPES = ("number", "force", "displacement"), ("parameters", "coordinates")


def nested(values: Any) -> Any:
    """Arrow's array of a NumPy array, with lists below its first axis; null if it is hidden."""
    column = pa.array(values.ravel())
    for length in values.shape[:0:-1]:
        column = pa.FixedSizeListArray.from_arrays(column, length)
    return pa.nulls(len(values), column.type) if np.isnan(values).any() else column


def main(folder: Path, out: Path) -> None:
    """Write the splits."""
    about = json.loads((folder / "about.json").read_text(encoding="utf-8"))
    columns = FIELDS + (OF_SHAPES if about["parameters"] else ())
    arrays = {name: np.load(folder / f"{name}.npy", mmap_mode="r") for name in columns}
    out.mkdir(parents=True)
    for split, rows in about["splits"].items():
        table = {name: nested(np.array(values[rows])) for name, values in arrays.items()}
        pq.write_table(pa.table(table), out / f"{split}.parquet", compression="zstd")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
