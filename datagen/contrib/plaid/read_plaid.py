"""Script: read a PLAID dataset of one mesh with pyplaid, and write it as arrays.

It runs in an environment with pyplaid, and imports nothing of this project::

    python read_plaid.py PLAID FOLDER INPUTS OUTPUTS

INPUTS and OUTPUTS are the names of fields at the nodes, separated by commas; if empty,
``force_x,force_y`` and ``displacement_x,displacement_y``, in space with z. FOLDER gets
``about.json`` and ``.npy`` files (see `datagen.contrib.plaid.importing`). What does not fit is
printed, with exit code 3.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from plaid import Sample
from plaid.infos import Infos
from plaid.storage import init_from_disk

UNFIT = 3
PLANE = ("TRI_", "QUAD_")
TAGS = ("clamped", "loadable")
NUMBER, STABLE = "sample_number", "stable"


class UnfitError(Exception):
    """The dataset does not fit; the text is for the user."""


def mesh_of(sample: Sample) -> tuple[np.ndarray, str, np.ndarray]:
    """Nodes, CGNS's name of the elements, and elements of a sample with one zone."""
    bases = sample.get_base_names()
    zones = [(base, zone) for base in bases for zone in sample.get_zone_names(base)]
    if len(zones) != 1:
        raise UnfitError(f"{len(zones)} zones in a sample, expected one")
    elements = sample.get_elements()
    if len(elements) != 1:
        kinds = ", ".join(elements) or "none"
        raise UnfitError(f"elements {kinds}, expected those of one kind")
    ((kind, cells),) = elements.items()
    nodes = sample.get_nodes()
    if kind.startswith(PLANE) and nodes.shape[1] == 3 and np.ptp(nodes[:, 2]) == 0:
        nodes = nodes[:, :2]
    return nodes, kind, cells


def read(source: Path, folder: Path, names: dict[str, list[str]]) -> None:
    """Write mesh, tags and fields of all samples, those of the split ``train`` first."""
    datasets, converters = init_from_disk(source)
    splits = [split for split in ("train", "test") if split in datasets]
    if not splits:
        raise UnfitError(f"splits {', '.join(datasets)}, expected train and test")
    rows = [(split, row) for split in splits for row in range(len(datasets[split]))]
    first: Sample | None = None
    fields: dict[str, Any] = {}
    numbers, stable = [], []
    for place, (split, row) in enumerate(rows):
        sample = converters[split].to_plaid(datasets[split], row)
        mesh = mesh_of(sample)
        if first is None:
            first, (nodes, kind, cells) = sample, mesh
            shape = (len(rows), *nodes.shape)
            axes = "xyz"[: nodes.shape[1]]
            for field in names:
                names[field] = names[field] or [f"{field}_{axis}" for axis in axes]
                if len(names[field]) != nodes.shape[1]:
                    raise UnfitError(
                        f"{len(names[field])} components of the {field}, expected {nodes.shape[1]}"
                    )
                fields[field] = np.lib.format.open_memmap(
                    folder / f"{field}.npy", mode="w+", dtype=np.float64, shape=shape
                )
        same = (np.array_equal(mesh[0], nodes), mesh[1] == kind, np.array_equal(mesh[2], cells))
        if not all(same):
            raise UnfitError(f"sample {row} of {split} has another mesh, expected one for all")
        for field, components in names.items():
            for axis, name in enumerate(components):
                values = sample.get_field(name)
                if values is None:
                    found = ", ".join(sample.get_field_names())
                    raise UnfitError(f"no field {name} at the nodes, found {found}")
                fields[field][place, :, axis] = values
        number = sample.get_global(NUMBER) if NUMBER in sample.get_global_names() else place
        numbers.append(int(np.ravel(number)[0]))
        if STABLE in sample.get_global_names():
            stable.append(bool(np.ravel(sample.get_global(STABLE))[0]))
    assert first is not None
    np.save(folder / "coordinates.npy", nodes.astype(np.float64))
    np.save(folder / "cells.npy", cells.astype(np.int64))
    np.save(folder / "number.npy", numbers)
    if len(stable) == len(rows):
        np.save(folder / "stable.npy", stable)
    for tag, tagged in first.get_nodal_tags().items():
        if tag in TAGS:
            np.save(folder / f"{tag}.npy", tagged.astype(np.int64))
    for values in fields.values():
        values.flush()
    infos = Infos.from_path(source / "infos.yaml")
    about = {
        "element": kind,
        "train": sum(split == "train" for split, _ in rows),
        "owner": infos.owner,
        "license": infos.license,
        "description": infos.data_description or "",
    }
    (folder / "about.json").write_text(json.dumps(about), encoding="utf-8")


if __name__ == "__main__":
    plaid_folder, arrays, inputs, outputs = sys.argv[1:]
    fields_by_name = {
        "force": inputs.split(",") if inputs else [],
        "displacement": outputs.split(",") if outputs else [],
    }
    try:
        read(Path(plaid_folder), Path(arrays), fields_by_name)
    except UnfitError as error:
        print(error)
        sys.exit(UNFIT)
