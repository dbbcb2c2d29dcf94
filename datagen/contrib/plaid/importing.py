"""Make a nodal dataset of a PLAID dataset whose samples all have one mesh.

Its inputs are forces at the nodes, its outputs displacements. The material is that of the case in
its description (`datagen export --format plaid` writes it), or given by the user.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.cases.dataset_settings import DatasetSettings
from datagen.contrib.plaid.exporting import CASE, ELEMENTS
from datagen.contrib.plaid.interpreter import require_interpreter, run_script
from datagen.farm.software_versions import software_versions
from datagen.transforms.claim_folder import claim_folder, locked, remove_other_shards
from datagen.transforms.reindexing import IMPORT
from shared_schema.common.arguments import checked_arguments
from shared_schema.common.configuration import changed, source_of, validate
from shared_schema.common.errors import InputError
from shared_schema.layout import NO_NODE, Arrays
from shared_schema.manifest import (
    Manifest,
    ShardEntry,
    digest_of,
    write_manifest,
)
from shared_schema.materials import as_tuple, materials_of
from shared_schema.shard import write_shard

CELLS = {element: cell for cell, element in ELEMENTS.items()}
UNKNOWN = {  # results of a solver that is not known
    "converged_reason": 2,
    "load_steps": 1,
    "cutbacks": 0,
    "newton_iterations": 0,
}


@checked_arguments
def import_plaid(
    source: Path | str,
    out: Path | str,
    *,
    inputs: str | None = None,
    outputs: str | None = None,
    python: Path | str | None = None,
    changes: Sequence[str] = (),
) -> Manifest:
    """Make a nodal dataset of a PLAID dataset, with its split.

    Parameters
    ----------
    source : Path or str
        PLAID dataset.
    out : Path or str
        Folder of the nodal dataset: new, or made by this step from the same dataset.
    inputs, outputs : str, optional
        Names of the components of force and displacement, separated by commas; by default
        ``force_x,force_y`` and ``displacement_x,displacement_y``, in space with z.
    python : Path or str, optional
        Interpreter of an environment with pyplaid; by default this one.
    changes : sequence of str
        Keys of the case, such as ``material.young_modulus=1e3`` (`changed`).

    Raises
    ------
    InputError
        If there is no pyplaid or no PLAID dataset, its samples have several meshes or not these
        fields, displacements or forces do not fit the tags, or its material is not known.
    WorkError
        If pyplaid fails.
    """
    source, out = Path(source), Path(out)
    interpreter = require_interpreter(python)
    if not (source / "infos.yaml").is_file():
        raise InputError(f"{source}: no infos.yaml in it, expected a PLAID dataset")
    with tempfile.TemporaryDirectory(prefix="plaid-") as scratch:
        try:
            names = inputs or "", outputs or ""
            run_script(interpreter, "read_plaid.py", source.resolve(), scratch, *names)
        except InputError as error:
            raise InputError(f"{source}: {error}") from None
        arrays = {path.stem: np.load(path, mmap_mode="r") for path in Path(scratch).glob("*.npy")}
        about = json.loads(Path(scratch, "about.json").read_text(encoding="utf-8"))
        case = _case(source, about, len(arrays["number"]), changes)
        return _write(source, out, case, about, arrays)


def _case(
    source: Path, about: dict[str, Any], samples: int, changes: Sequence[str]
) -> dict[str, Any]:
    """Case of the dataset: that of its description, or name and split only, with changes."""
    line = about["description"].rpartition("\n")[2]
    try:
        found = json.loads(line.removeprefix(CASE)) if line.startswith(CASE) else None
    except ValueError:
        found = None
    settings = {"samples": samples, "test_fraction": 1 - about["train"] / samples}
    case = found if isinstance(found, dict) else {"name": source.name, "dataset": settings}
    case = changed(case, changes)
    said = source_of(str(source), changes)
    if "material" not in case:
        raise InputError(
            f"{said}: its description names no material, expected --set "
            "'material={young_modulus: …, poisson_ratio: …}'"
        )
    materials = materials_of(case["material"], f"{said}: material")
    if any(material.family_count for material in as_tuple(materials)):
        raise InputError(
            f"{said}: key 'material.fibres': PLAID carries no directions of cells, expected a "
            "material without fibres"
        )
    validate(DatasetSettings, case.get("dataset"), f"{said}: dataset")
    return case


def _write(
    source: Path, out: Path, case: dict[str, Any], about: dict[str, Any], arrays: Arrays
) -> Manifest:
    """Write shards and manifest into the locked folder."""
    if about["element"] not in CELLS:
        raise InputError(f"{source}: elements {about['element']}, expected {', '.join(CELLS)}")
    cell_type, digest = CELLS[about["element"]], digest_of(case)
    order = np.argsort(arrays["number"])
    if len(np.unique(arrays["number"])) != len(order):
        raise InputError(f"{source}: a sample number occurs twice")
    is_test = (np.arange(len(order)) >= about["train"])[order]
    mesh = _mesh(source, arrays)
    force, displacement = arrays["force"], arrays["displacement"]
    width = max(1, max(int((force[row] != 0).any(axis=-1).sum()) for row in order))
    manifest = Manifest(
        kind="nodal",
        name=str(case.get("name", source.name)),
        case=case,
        case_digest=digest,
        seed=int(case["dataset"].get("seed", 0)),
        software=software_versions(),
        dimension=mesh["mesh/coordinates"].shape[1],
        samples=len(order),
        failed=0,
        transforms=(
            {
                "name": IMPORT,
                "format": "plaid",
                "owner": about["owner"],
                "license": about["license"],
                "test": np.flatnonzero(is_test).tolist(),
            },
        ),
        shards=(),
    )
    size = validate(DatasetSettings, case["dataset"], str(source)).shard_size
    entries = []
    with locked(out):
        claim_folder(out, manifest)
        for shard, start in enumerate(range(0, len(order), size)):
            rows = order[start : start + size]
            part = {**mesh, **_samples(force[rows], displacement[rows], start, width)}
            if "stable" in arrays:
                part["samples/stable"] = np.array(arrays["stable"])[rows]
            path = out / f"shard-{shard:05d}.h5"
            checksum = write_shard(path, "nodal", part, digest, cell_type)
            entries.append(ShardEntry(file=path.name, samples=len(rows), failed=0, sha256=checksum))
        remove_other_shards(out, entries)
        return write_manifest(out, manifest.model_copy(update={"shards": tuple(entries)}))


def _mesh(source: Path, arrays: Arrays) -> Arrays:
    """Mesh of the dataset; clamped and loadable nodes by their tags, or by the samples.

    Raises
    ------
    InputError
        If no node is clamped, a clamped node moves or is loaded, or another than a loadable one is
        loaded.
    """
    moved = np.any([(values != 0).any(axis=-1) for values in arrays["displacement"]], axis=0)
    loaded = np.any([(values != 0).any(axis=-1) for values in arrays["force"]], axis=0)
    count = len(arrays["coordinates"])
    clamped = _tagged(arrays, "clamped", count, ~moved)
    loadable = _tagged(arrays, "loadable", count, loaded)
    for wrong, text in (
        (not clamped.any(), "no node is at rest in all samples, expected clamped ones"),
        ((clamped & moved).any(), "a node with the tag clamped moves"),
        ((loaded & ~loadable).any(), "a node without the tag loadable is loaded"),
        ((loaded & clamped).any(), "a clamped node is loaded"),
    ):
        if wrong:
            raise InputError(f"{source}: {text}")
    return {
        "mesh/coordinates": np.array(arrays["coordinates"]),
        "mesh/cells": np.array(arrays["cells"]),
        "mesh/clamped": clamped,
        "mesh/loadable": loadable,
    }


def _tagged(
    arrays: Arrays, tag: str, count: int, otherwise: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Nodes that have a tag, (count,); others if the dataset does not have it."""
    if tag not in arrays:
        return otherwise
    nodes = np.zeros(count, dtype=bool)
    nodes[arrays[tag]] = True
    return nodes


def _samples(
    force: NDArray[np.float64], displacement: NDArray[np.float64], start: int, width: int
) -> Arrays:
    """Arrays of some samples: loads of the nodes that have one, no results of a solver."""
    count, dimension = len(force), force.shape[-1]
    loaded = np.full((count, width), NO_NODE, dtype=np.int64)
    loads = np.zeros((count, width, dimension))
    for row, forces in enumerate(force):
        nodes = np.flatnonzero(forces.any(axis=-1))
        loaded[row, : len(nodes)], loads[row, : len(nodes)] = nodes, forces[nodes]
    return {
        "samples/number": np.arange(start, start + count),
        "samples/loaded_nodes": loaded,
        "samples/force": loads,
        "samples/displacement": np.array(displacement),
        **{f"samples/{name}": np.full(count, value) for name, value in UNKNOWN.items()},
        "samples/residual_norm": np.zeros(count),
        "samples/wall_time": np.zeros(count),
        "failed/number": np.zeros(0, dtype=np.int64),
        "failed/loaded_nodes": np.zeros((0, width), dtype=np.int64),
        "failed/force": np.zeros((0, width, dimension)),
        "failed/load_factor": np.zeros(0),
        "failed/reason": np.zeros(0, dtype=object),
    }
