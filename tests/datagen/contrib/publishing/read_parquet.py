"""Script for an environment with pyarrow: write the columns of some files of Parquet as .npz."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

folder, out = map(Path, sys.argv[1:])
arrays: dict[str, np.ndarray] = {}
for path in folder.glob("*.parquet"):
    table = pq.read_table(path)
    for name in table.column_names:
        values = table[name].to_pylist()
        arrays[f"{path.stem}/{name}"] = np.array(values, dtype=np.float64)
np.savez(out, allow_pickle=False, **arrays)
