r"""A structured dataset as one small file, to be carried to a machine without a network.

Displacements are rounded to multiples of a step h, and replaced by their differences along every
axis of the grid, which are small because neighbouring nodes move alike:

.. math:: q = \operatorname{round}(u / h), \qquad δ = Δ_x Δ_y Δ_z\, q

The sums along the axes give q back exactly, so the error of a displacement is h/2 at most. All
other arrays are exact.
"""

from __future__ import annotations

import io
import json
import lzma
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared_schema import (
    DatasetReader,
    Manifest,
    ShardEntry,
    StructuredInfo,
    write_manifest,
    write_shard,
)
from shared_schema.common import complete_or_absent

SUFFIX = ".npz.xz"
STEP = 1e-6  # m
SAMPLES = ("samples/number", "samples/is_test", "samples/force", "samples/displacement")
DISPLACEMENT = "samples/displacement"


def rounded_differences(field: NDArray[np.float32], step: float) -> NDArray[np.int32]:
    """Round a field (N, d, nx, ny[, nz]) and take the differences along the axes of the grid."""
    result = np.round(field.astype(np.float64) / step).astype(np.int32)
    for axis in range(2, field.ndim):
        result = np.diff(result, axis=axis, prepend=np.int32(0))
    return result


def summed(differences: NDArray[np.int32], step: float) -> NDArray[np.float32]:
    """Return the field of some differences, (N, d, nx, ny[, nz])."""
    result = differences
    for axis in range(2, differences.ndim):
        result = np.cumsum(result, axis=axis, dtype=np.int32)
    return (result * step).astype(np.float32)


def pack(folder: Path, path: Path, samples: int | None = None, step: float = STEP) -> int:
    """Write the first samples of a structured dataset into one file; return their number.

    The grid's points are nodes of the mesh. The stiffness is left out.
    """
    reader = DatasetReader(folder, "structured")
    samples_of = reader.joined(SAMPLES)
    order = np.argsort(samples_of["samples/number"])[:samples]
    chosen = {name: values[order] for name, values in samples_of.items()}
    chosen[DISPLACEMENT] = rounded_differences(chosen[DISPLACEMENT], step)
    described = {"manifest": reader.manifest.spelled(), "cell_type": reader.cell_type, "step": step}
    buffer = io.BytesIO()
    arrays = {"description": np.array(json.dumps(described)), **reader.body, **chosen}
    texts = {name: each.astype(str) for name, each in arrays.items() if each.dtype == object}
    np.savez(buffer, allow_pickle=False, **arrays | texts)
    with complete_or_absent(path) as partial:
        partial.write_bytes(lzma.compress(buffer.getbuffer(), preset=6))
    return len(order)


def unpack(path: Path, folder: Path) -> None:
    """Write a packed dataset as a structured dataset with one shard.

    The counts of the splits are those of the carried samples; scales stay those of all samples.
    """
    with np.load(io.BytesIO(lzma.decompress(path.read_bytes())), allow_pickle=False) as stored:
        arrays = {name: stored[name] for name in stored.files}
    described = json.loads(str(arrays.pop("description")))
    source = Manifest.model_validate_json(described["manifest"])
    arrays[DISPLACEMENT] = summed(arrays[DISPLACEMENT], described["step"])
    for name, values in arrays.items():
        if values.dtype.kind == "U":
            arrays[name] = values.astype(object)
    count, test = len(arrays["samples/number"]), int(arrays["samples/is_test"].sum())
    folder.mkdir(parents=True, exist_ok=True)
    file, cell_type = "shard-00000.h5", described["cell_type"]
    digest = write_shard(folder / file, "structured", arrays, source.case_digest, cell_type)
    assert source.structured is not None
    info = source.structured.model_dump() | {"train": count - test, "test": test}
    update = {
        "samples": count,
        "failed": 0,
        "shards": (ShardEntry(file=file, samples=count, failed=0, sha256=digest),),
        "structured": StructuredInfo(**info | {"stiffness": None}),
        "transforms": (*source.transforms, {"name": "rounding", "step_m": described["step"]}),
    }
    write_manifest(folder, source.model_copy(update=update))
