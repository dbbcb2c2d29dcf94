"""Check a dataset against the contract and name every violation.

The checker reads every byte: it holds the manifest against its digest, every shard against its
checksum, and every array against the layout. It does not stop at the first problem.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.bodies.cells import CELL_TYPES, conformity_problem
from shared_schema.common.errors import InputError
from shared_schema.common.files import require_plain, sha256
from shared_schema.content_problems import content_problems
from shared_schema.layout import Arrays
from shared_schema.manifest import Manifest, digest_of, read_manifest, require_dataset
from shared_schema.shard import Attributes, array_problems, read_arrays, read_attributes
from shared_schema.stiffness import STIFFNESS_FILE, read_stiffness, stiffness_problems


@checked_arguments
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

    Raises
    ------
    InputError
        If there is no dataset, or it is not finished.
    """
    folder = Path(dataset)
    require_dataset(folder)
    try:
        manifest = read_manifest(folder)
    except InputError as error:
        return [str(error)]
    problems = _manifest_problems(folder, manifest)
    lengths: dict[str, tuple[int, ...]] = {}
    numbers: list[NDArray[np.int64]] = []
    test = 0
    mesh: Arrays = {}
    for entry in manifest.shards:
        path = folder / entry.file
        lengths = {k: v for k, v in lengths.items() if k not in ("sample", "failed")}
        lengths |= entry.lengths(manifest)
        try:
            require_plain(folder, path)
            if not path.is_file():
                problems.append(f"{entry.file}: missing")
                continue
            if sha256(path) != entry.sha256:  # a damaged file must not reach the HDF5 library
                problems.append(f"{entry.file}: {_damage(path)}")
                continue
            attributes = read_attributes(path, manifest.kind)
            arrays = read_arrays(path, manifest.kind, lengths=lengths)
        except InputError as error:
            problems.append(f"{entry.file}: {str(error).removeprefix(f'{path}: ')}")
            continue
        problems += [f"{entry.file}: {text}" for text in _attribute_problems(manifest, attributes)]
        found = array_problems(manifest.kind, arrays, lengths)
        if not found:
            found = content_problems(manifest, arrays)
        if not found and not mesh:
            found = _mesh_problems(arrays, str(attributes["cell_type"]))
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


def _mesh_problems(arrays: Arrays, cell_type: str) -> list[str]:
    """List what is wrong with the cells; their type is checked with the other attributes."""
    if cell_type not in CELL_TYPES:
        return []
    problem = conformity_problem(arrays["mesh/coordinates"], arrays["mesh/cells"], cell_type)
    return [] if problem is None else [f"dataset 'mesh/cells': {problem}"]


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
    try:
        require_plain(folder, path)
        if not path.is_file():
            return ["missing"]
        if sha256(path) != manifest.stiffness_checksum:
            return [_damage(path)]
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


def _damage(path: Path) -> str:
    kind = "empty" if path.stat().st_size == 0 else "damaged"
    return f"{kind}, its checksum does not match the manifest"


def require_intact(folder: Path, manifest: Manifest) -> None:
    """Raise InputError at the first file of a dataset that is missing, damaged, or a link."""
    files = {entry.file: entry.sha256 for entry in manifest.shards}
    if manifest.stiffness_checksum is not None:
        files[STIFFNESS_FILE] = manifest.stiffness_checksum
    for file, checksum in files.items():
        path = folder / file
        require_plain(folder, path)
        if not path.is_file():
            raise InputError(f"{path}: no such file")
        if sha256(path) != checksum:
            raise InputError(f"{path}: {_damage(path)}")
