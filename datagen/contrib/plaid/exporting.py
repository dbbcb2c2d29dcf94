"""Write a nodal dataset in the PLAID format, with training and test split.

The arrays go through files: pyplaid needs newer packages than Debian's dolfinx, so that its writer
(`write_plaid`) may run in an environment of its own.
"""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from datagen.transforms.reindexing import nodal_forces_of, split_of
from shared_schema.common.arguments import checked_arguments
from shared_schema.common.bodies.shape_family import ShapeFamily
from shared_schema.common.configuration import validate
from shared_schema.common.errors import InputError, WorkError
from shared_schema.dataset_reader import DatasetReader
from shared_schema.manifest import Manifest
from shared_schema.samples.dataset_settings import DatasetSettings

MODULE = "plaid"
ELEMENTS = {  # meshio's names and CGNS's, with the same order of corners
    "triangle": "TRI_3",
    "quad": "QUAD_4",
    "tetra": "TETRA_4",
    "hexahedron": "HEXA_8",
}
NOT_CARRIED = ("mesh/held", "mesh/material", "mesh/fibres", "mesh/pressed")
SCRIPT = Path(__file__).with_name("write_plaid.py")
Backend = Literal["hf_datasets", "cgns", "zarr"]
Splits = dict[str, NDArray[np.int64]]
CASE = "Case: "  # before the case as JSON, in the last line of the description


def require_interpreter(python: Path | str | None) -> str:
    """Return the path of a Python that can import pyplaid.

    Parameters
    ----------
    python : Path or str, optional
        Interpreter of another environment; by default this one.

    Raises
    ------
    InputError
        If it is no Python, or has no pyplaid.
    """
    hint = "`python3 -m venv plaid && plaid/bin/pip install pyplaid` makes an environment"
    if python is None:
        if importlib.util.find_spec(MODULE) is None:
            raise InputError(
                f"--python: pyplaid is not installed here; {hint}, --python plaid/bin/python "
                "names it"
            )
        return sys.executable
    check = f"import importlib.util, sys; sys.exit(importlib.util.find_spec({MODULE!r}) is None)"
    try:
        done = subprocess.run([python, "-I", "-c", check], capture_output=True, check=False)
    except OSError as error:
        raise InputError(f"--python '{python}': cannot be run ({error.strerror})") from None
    if done.returncode != 0:
        raise InputError(f"--python '{python}': has no pyplaid; {hint}")
    return str(python)


def run_script(python: str, script: Path, *arguments: Path) -> None:
    """Run a script that imports pyplaid, or what it brings, and nothing of this project.

    Raises
    ------
    WorkError
        If it ends with an error.
    """
    done = subprocess.run(
        [python, "-I", str(script), *map(str, arguments)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise WorkError(f"pyplaid ended with exit code {done.returncode}: {last}")


@checked_arguments
def export_plaid(
    nodal: Path | str,
    out: Path | str,
    *,
    backend: Backend = "hf_datasets",
    python: Path | str | None = None,
    owner: str = "unknown",
    license: str = "unknown",
) -> tuple[int, int]:
    """Write all solved samples of a nodal dataset as a PLAID dataset, by pyplaid itself.

    The splits ``train`` and ``test`` are those of `datagen structure`; the problem definition
    ``displacement`` has the forces as input and the displacements as output.

    Parameters
    ----------
    nodal : Path or str
        Nodal dataset.
    out : Path or str
        New folder; it appears complete, or not at all.
    backend : {"hf_datasets", "cgns", "zarr"}
        pyplaid's storage: the first is for the Hugging Face Hub, and keeps fields in float32; the
        others keep float64.
    python : Path or str, optional
        Interpreter of an environment with pyplaid; by default this one.
    owner, license : str
        Of the dataset, for its `infos.yaml`.

    Returns
    -------
    train, test : int
        Number of samples of each split.

    Raises
    ------
    InputError
        If there is no intact nodal dataset of two samples at least, its cells have no name in CGNS,
        the folder exists, or there is no pyplaid.
    WorkError
        If pyplaid fails.
    """
    folder, out = Path(nodal), Path(out)
    require_new(out)
    interpreter = require_interpreter(python)
    reader = carried(folder)
    splits = splits_of(reader.manifest)
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=".partial-") as scratch:
        arrays, made = Path(scratch, "arrays"), Path(scratch, out.name)
        write_arrays(reader, arrays)
        write_about(reader, arrays, splits, backend=backend, owner=owner, license=license)
        run_script(interpreter, SCRIPT, arrays, made)
        made.rename(out)
    return len(splits["train"]), len(splits["test"])


def require_new(out: Path) -> None:
    """Raise InputError unless a folder can be made there, in one that exists."""
    if out.exists():
        raise InputError(f"--out '{out}': exists, expected a new folder")
    if not out.parent.is_dir():
        raise InputError(f"--out '{out}': no such folder {out.parent}")


def carried(folder: Path) -> DatasetReader:
    """Read a nodal dataset that the format can carry.

    Raises
    ------
    InputError
        As `export_plaid`.
    """
    reader = DatasetReader(folder, "nodal")
    reader.require_equilibria()
    manifest = reader.manifest
    if reader.cell_type not in ELEMENTS:
        expected = ", ".join(ELEMENTS)
        raise InputError(f"{folder}: cells are {reader.cell_type}, expected one of {expected}")
    left_out = [name for name in NOT_CARRIED if name in reader.body]
    left_out += ["actuators"] if manifest.case.get("actuators") else []
    if left_out:
        raise InputError(
            f"{folder}: has '{left_out[0]}', expected a dataset of one material, clamped nodes and "
            "dead loads"
        )
    if manifest.samples < 2:
        raise InputError(f"{folder}: {manifest.samples} samples, expected 2 at least")
    return reader


def splits_of(manifest: Manifest) -> Splits:
    """Rows of the splits of `datagen structure`, samples in ascending order of their number."""
    of = validate(DatasetSettings, manifest.case.get("dataset"), f"{manifest.name}: case.dataset")
    is_test = split_of(manifest, of)
    return {"train": np.flatnonzero(~is_test), "test": np.flatnonzero(is_test)}


def write_about(reader: DatasetReader, folder: Path, splits: Splits, **given: str) -> None:
    """Write ``about.json`` beside the arrays: splits, names, and what is given as it is."""
    family = ShapeFamily.of_arrays(reader.body)
    about = {
        "dimension": reader.manifest.dimension,
        "element": ELEMENTS[reader.cell_type],
        "parameters": () if family is None else family.names,
        "splits": {name: rows.tolist() for name, rows in splits.items()},
        **given,
        **described(reader.manifest),
    }
    (folder / "about.json").write_text(json.dumps(about), encoding="utf-8")


def described(manifest: Manifest) -> dict[str, str]:
    """Texts about a dataset for ``infos.yaml``."""
    case = json.dumps(manifest.case, sort_keys=True, ensure_ascii=False)
    return {
        "physics": "large-deformation hyperelasticity, static equilibrium under nodal forces",
        "simulator": ", ".join(f"{name} {version}" for name, version in manifest.software.items()),
        "description": (
            f"Equilibria of case {manifest.name}: nodal forces in N and displacements in m on one "
            "mesh, coordinates in m (of a family of shapes, those of each sample, beside its "
            "parameters), nodal tags `clamped` and `loadable`. Digest of the source: "
            f"{manifest.digest}.\n{CASE}{case}"
        ),
    }


def write_arrays(reader: DatasetReader, folder: Path) -> None:
    """Write mesh, tags and samples as ``.npy`` files, shard by shard, samples by their number."""
    folder.mkdir()
    body, manifest = reader.body, reader.manifest
    np.save(folder / "coordinates.npy", body["mesh/coordinates"])
    np.save(folder / "cells.npy", body["mesh/cells"])
    for tag in ("clamped", "loadable"):
        np.save(folder / f"{tag}.npy", np.flatnonzero(body[f"mesh/{tag}"]))
    order = reader.ascending()
    shape = (manifest.samples, *body["mesh/coordinates"].shape)
    family = ShapeFamily.of_arrays(body)
    of_shapes = () if family is None else ("coordinates",)
    fields: dict[str, Any] = {
        name: np.lib.format.open_memmap(
            folder / f"{name}.npy", mode="w+", dtype=np.float64, shape=shape
        )
        for name in ("force", "displacement", *of_shapes)
    }
    numbers = np.empty(manifest.samples, dtype=np.int64)
    stable = np.ones(manifest.samples, dtype=bool)
    parameters = np.empty((manifest.samples, 0 if family is None else len(family.names)))
    is_known = True
    for shard, (_, arrays) in enumerate(reader):
        place = order.places(shard)
        row = order.row[place]
        fields["force"][place] = nodal_forces_of(arrays)[row]
        for name in ("displacement", *of_shapes):
            fields[name][place] = arrays[f"samples/{name}"][row]
        if family is not None:
            parameters[place] = arrays["samples/parameters"][row]
        numbers[place] = arrays["samples/number"][row]
        is_known = is_known and "samples/stable" in arrays
        if is_known:
            stable[place] = arrays["samples/stable"][row]
    if is_known:
        np.save(folder / "stable.npy", stable)
    np.save(folder / "number.npy", numbers)
    np.save(folder / "parameters.npy", parameters)
    for values in fields.values():
        values.flush()
