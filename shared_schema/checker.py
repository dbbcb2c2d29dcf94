"""Check a dataset against the contract and name every violation.

The checker reads every byte: it holds the manifest against its digest, every shard against its
checksum, and every array against the layout. It does not stop at the first problem.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared_schema.body_problems import body_problems
from shared_schema.common.bodies.cells import CELL_TYPES
from shared_schema.common.checksum import sha256
from shared_schema.common.errors import InputError
from shared_schema.grid_arrays import grid_problems
from shared_schema.layout import NO_NODE, Arrays
from shared_schema.manifest import Manifest, digest_of, read_manifest
from shared_schema.shard_problems import array_problems
from shared_schema.shard_reader import Attributes, read_arrays, read_attributes
from shared_schema.stiffness import STIFFNESS_FILE, read_stiffness, stiffness_problems


def check_dataset(dataset: Path | str) -> list[str]:
    """List every violation of the contract that a dataset has; empty if it has none.

    Parameters
    ----------
    dataset : Path or str
        Folder of the dataset.

    Returns
    -------
    list of str
        One line a violation: file, dataset, what was found and what was expected.
    """
    folder = Path(dataset)
    try:
        manifest = read_manifest(folder)
    except InputError as error:
        return [str(error)]
    problems = _manifest_problems(folder, manifest)
    lengths: dict[str, tuple[int, ...]] = {"dim": (manifest.dimension,)}
    numbers: list[NDArray[np.int64]] = []
    test = 0
    mesh: Arrays = {}
    for entry in manifest.shards:
        path = folder / entry.file
        if not path.is_file():
            problems.append(f"{entry.file}: missing")
            continue
        if sha256(path) != entry.sha256:  # a damaged file must not reach the HDF5 library
            problems.append(f"{entry.file}: {_damage(path)}")
            continue
        try:
            attributes = read_attributes(path, manifest.kind)
            arrays = read_arrays(path, manifest.kind)
        except InputError as error:
            problems.append(f"{entry.file}: {str(error).removeprefix(f'{path}: ')}")
            continue
        problems += [f"{entry.file}: {text}" for text in _attribute_problems(manifest, attributes)]
        lengths = {k: v for k, v in lengths.items() if k not in ("sample", "failed")}
        lengths["sample"] = (entry.samples,)
        if manifest.kind == "nodal":
            lengths["failed"] = (entry.failed,)
        found = array_problems(manifest.kind, arrays, lengths)
        if not found:
            found = _content_problems(manifest, arrays)
        if not found:
            for name in (name for name in arrays if name.startswith(("mesh/", "grid/"))):
                if not np.array_equal(mesh.setdefault(name, arrays[name]), arrays[name]):
                    found.append(f"dataset '{name}' is not that of the shards before")
            numbers.append(arrays["samples/number"])
            if manifest.kind == "nodal":
                numbers.append(arrays["failed/number"])
            else:
                test += int(arrays["samples/is_test"].sum())
        problems += [f"{entry.file}: {problem}" for problem in found]
    problems += _number_problems(manifest, np.concatenate(numbers) if numbers else None)
    info = manifest.structured
    if info is not None and not problems and test != info.test:
        problems.append(f"manifest: 'test' is {info.test}, the shards hold {test}")
    if manifest.stiffness_checksum is not None:
        dofs = mesh["mesh/coordinates"].size if mesh else None
        problems += [
            f"{STIFFNESS_FILE}: {text}" for text in _stiffness_problems(folder, manifest, dofs)
        ]
    return problems


def _number_problems(manifest: Manifest, numbers: NDArray[np.int64] | None) -> list[str]:
    """Name sample numbers that occur twice or may not be, in the shards that can be read."""
    if numbers is None or numbers.size == 0:
        return []
    if len(np.unique(numbers)) != len(numbers):
        return ["a sample number appears more than once"]
    if numbers.min() < 0:
        return [f"sample number {numbers.min()}, expected none below 0"]
    load_cases = sum(entry.samples + entry.failed for entry in manifest.shards)
    if manifest.kind == "nodal" and numbers.max() >= load_cases:
        return [f"sample number {numbers.max()}, expected 0 to {load_cases - 1}"]
    return []


def _stiffness_problems(folder: Path, manifest: Manifest, dofs: int | None) -> list[str]:
    """List what is wrong with the stiffness file; its size is checked if the mesh is known."""
    path = folder / STIFFNESS_FILE
    if not path.is_file():
        return ["missing"]
    if sha256(path) != manifest.stiffness_checksum:
        return [_damage(path)]
    try:
        stiffness = read_stiffness(folder)
    except InputError as error:
        return [str(error).removeprefix(f"{path}: ")]
    return stiffness_problems(stiffness, dofs) if dofs is not None else []


def _attribute_problems(manifest: Manifest, attributes: Attributes) -> list[str]:
    problems = []
    if attributes["case_digest"] not in manifest.case_digests:
        problems.append("attribute 'case_digest' is not the manifest's: made from another case")
    if attributes["cell_type"] not in CELL_TYPES:
        problems.append(
            f"attribute 'cell_type' is {attributes['cell_type']!r}, "
            f"expected one of {', '.join(CELL_TYPES)}"
        )
    return problems


def _manifest_problems(folder: Path, manifest: Manifest) -> list[str]:
    problems = []
    if manifest.case_digest != digest_of(manifest.case):
        problems.append("manifest: 'case_digest' is not the digest of 'case'")
    problems += _history_problems(manifest)
    for name in ("samples", "failed"):
        total = sum(getattr(entry, name) for entry in manifest.shards)
        if total != getattr(manifest, name):
            problems.append(
                f"manifest: '{name}' is {getattr(manifest, name)}, the shards hold {total}"
            )
    listed = {entry.file for entry in manifest.shards}
    for path in sorted(folder.glob("shard-*")):
        if path.name not in listed:
            problems.append(f"{path.name}: not in the manifest")
    info = manifest.structured
    if manifest.stiffness_checksum is None and (folder / STIFFNESS_FILE).exists():
        problems.append(f"{STIFFNESS_FILE}: not in the manifest")
    if (manifest.kind == "structured") != (info is not None):
        problems.append(f"manifest: 'structured' does not fit the kind '{manifest.kind}'")
    elif info is not None and manifest.stiffness is not None:
        problems.append("manifest: 'stiffness' does not fit the kind 'structured'")
    elif info is not None and info.train + info.test != manifest.samples:
        problems.append(
            f"manifest: train {info.train} + test {info.test} is not samples {manifest.samples}"
        )
    return problems


def _history_problems(manifest: Manifest) -> list[str]:
    """Name stages before which the dataset was no smaller one of the same case."""
    problems = []
    settings = manifest.case.get("dataset")
    for number, stage in enumerate(manifest.history):
        load_cases = stage.samples + stage.failed
        smaller = {**settings, "samples": load_cases} if isinstance(settings, dict) else None
        if stage.case_digest != digest_of({**manifest.case, "dataset": smaller}):
            problems.append(
                f"manifest: 'history.{number}' is not the same case with {load_cases} samples"
            )
    return problems


def _content_problems(manifest: Manifest, arrays: Arrays) -> list[str]:
    """List what is wrong with the values: node numbers, load cases, the grid."""
    problems = []
    nodes = len(arrays["mesh/coordinates"])
    for name in ("mesh/cells", "samples/loaded_nodes", "failed/loaded_nodes"):
        if name in arrays and arrays[name].size:
            lowest = 0 if name == "mesh/cells" else NO_NODE
            if arrays[name].min() < lowest or arrays[name].max() >= nodes:
                problems.append(f"dataset '{name}' names a node outside 0 … {nodes - 1}")
    if not problems:
        for group in ("samples", "failed"):
            if f"{group}/loaded_nodes" in arrays:
                problems += _load_problems(arrays, group)
        problems += _support_problems(arrays) + body_problems(arrays)
    if manifest.kind == "nodal":
        problems += _result_problems(arrays)
    if manifest.structured is None:
        return problems
    if ("grid/sources" in arrays) != (manifest.structured.embedding is not None):
        problems.append("the grid is embedded, or not, against what the manifest says")
    return problems + grid_problems(arrays, manifest.structured.grid_shape)


def _load_problems(arrays: Arrays, group: str) -> list[str]:
    """Name padding before a loaded node or under force, clamped loaded nodes, and repeated ones."""
    force = "samples/nodal_force" if "samples/nodal_force" in arrays else f"{group}/force"
    name, nodes = f"{group}/loaded_nodes", arrays[f"{group}/loaded_nodes"]
    is_padding = nodes == NO_NODE
    problems = []
    if np.any(is_padding[:, :-1] & ~is_padding[:, 1:]):
        problems.append(f"dataset '{name}' has padding before a loaded node")
    if np.any(arrays[force][is_padding]):
        problems.append(f"dataset '{force}' is not zero where '{name}' is padding")
    if np.any(arrays["mesh/clamped"][nodes[~is_padding]]):
        problems.append(f"dataset '{name}' names a clamped node")
    elif not np.all(arrays["mesh/loadable"][nodes[~is_padding]]):
        problems.append(f"dataset '{name}' names a node that is not loadable")
    ordered = np.sort(nodes, axis=1)
    if np.any((ordered[:, 1:] == ordered[:, :-1]) & (ordered[:, 1:] != NO_NODE)):
        problems.append(f"dataset '{name}' names a node twice in one load case")
    return problems


def _support_problems(arrays: Arrays) -> list[str]:
    """Name displacements of clamped nodes: at the nodes, or at the grid points that are nodes."""
    clamped = arrays["mesh/clamped"]
    for name in ("samples/nodal_displacement", "samples/displacement"):
        values = arrays.get(name)
        if values is None:
            continue
        if values.shape[1:] == (len(clamped), arrays["mesh/coordinates"].shape[1]):
            moved = values[:, clamped]
        elif "grid/node_at" in arrays:
            node_at = arrays["grid/node_at"]
            inside = (node_at >= 0) & (node_at < len(clamped))
            moved = values[..., inside & clamped[np.where(inside, node_at, 0)]]
        else:
            continue
        if np.any(moved):
            return [f"dataset '{name}' moves a clamped node"]
    return []


def _result_problems(arrays: Arrays) -> list[str]:
    """Name results that no solver gives: reasons, counts, times and norms out of their range."""
    problems = []
    for name, lowest, highest in (
        ("samples/converged_reason", 2, 7),  # those of convergence in PETSc
        ("samples/load_steps", 1, np.inf),
        ("samples/cutbacks", 0, np.inf),
        ("samples/newton_iterations", 0, np.inf),
        ("samples/residual_norm", 0, np.inf),
        ("samples/wall_time", 0, np.inf),
        ("failed/load_factor", 0, 1),
    ):
        values = arrays[name]
        if values.size and (values.min() < lowest or values.max() > highest):
            wrong = values[(values < lowest) | (values > highest)][0]
            expected = f"at least {lowest}" if highest == np.inf else f"{lowest} to {highest}"
            problems.append(f"dataset '{name}' is {wrong}, expected {expected}")
    if not all(arrays["failed/reason"]):
        problems.append("dataset 'failed/reason' has an empty text")
    return problems


def _damage(path: Path) -> str:
    kind = "empty" if path.stat().st_size == 0 else "damaged"
    return f"{kind}, its checksum does not match the manifest"


def require_intact(folder: Path, manifest: Manifest) -> None:
    """Raise InputError at the first file of a dataset that is missing or damaged."""
    files = {entry.file: entry.sha256 for entry in manifest.shards}
    if manifest.stiffness_checksum is not None:
        files[STIFFNESS_FILE] = manifest.stiffness_checksum
    for file, checksum in files.items():
        path = folder / file
        if not path.is_file():
            raise InputError(f"{path}: no such file")
        if sha256(path) != checksum:
            raise InputError(f"{path}: {_damage(path)}")
