"""The manifest of a dataset: its kind, its origin, and the checksum of every file in it.

``manifest.json`` is written last and in one canonical spelling, so that its presence means a
complete dataset and any changed byte is found. An interrupted `datagen run` leaves a folder
``.journal`` with the case and its shards instead.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from shared_schema.common.configuration import Frozen, absent, validate
from shared_schema.common.errors import InputError
from shared_schema.common.files import require_plain, write_text
from shared_schema.layout import SCHEMA_VERSION, Kind

MANIFEST = "manifest.json"
UNITS = {"length": "m", "force": "N", "stress": "Pa", "time": "s"}


class ShardEntry(Frozen):
    """One shard of the dataset: its file, its counts, and its checksum.

    Attributes
    ----------
    file : str
        File name inside the dataset's folder.
    samples : int
        Solved samples in it.
    failed : int
        Load cases that could not be solved; a structured shard has no rows of them.
    sha256 : str
    """

    file: str = Field(pattern=r"^shard-\d{5}\.h5$")
    samples: int = Field(ge=0)
    failed: int = Field(ge=0)
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")

    def lengths(self, manifest: Manifest) -> dict[str, tuple[int, ...]]:
        """Lengths of the axes of the shard's arrays, as far as the manifest knows them."""
        failed = {"failed": (self.failed,)} if manifest.kind == "nodal" else {}
        return {"dim": (manifest.dimension,), "sample": (self.samples,), **failed}


class SolverRecord(Frozen):
    """How the load cases of a dataset were solved.

    Attributes
    ----------
    linear_solver : str
        Name of the linear solver: that of the case, or the one chosen for it.
    unknowns : int
        Number of unknowns of a load case.
    memory : int or None
        Largest resident memory of a rank in bytes; absent from the file if it is not known.
    stability : str or None
        What became of unstable equilibria: "follow", "fail" or "allow"; absent from the file if
        stability was not looked at.
    imperfection : int or None
        Seed of the disturbance that decided in which direction unstable equilibria were left.
    """

    linear_solver: str
    unknowns: int = Field(gt=0)
    memory: int | None = Field(None, gt=0, exclude_if=absent)
    stability: str | None = Field(None, exclude_if=absent)
    imperfection: int | None = Field(None, exclude_if=absent)


class ComponentStatistics(Frozen):
    """Statistics of one field over the grid points that are nodes, component by component.

    Attributes
    ----------
    mean, std, max_abs : tuple of d floats
        In the units of the field.
    """

    mean: tuple[float, ...]
    std: tuple[float, ...]
    max_abs: tuple[float, ...]


NodeOrder = Literal["preferred", "gmsh", "random"]


class EmbeddingInfo(Frozen):
    """Accuracy of a grid that is embedded on a mesh.

    Attributes
    ----------
    mean_error, max_error : float
        Mean and largest ‖u_grid→nodes − u‖₂ / ‖u‖₂ of a sample's displacement.
    """

    mean_error: float = Field(ge=0)
    max_error: float = Field(ge=0)


class StructuredInfo(Frozen):
    """Additional content of a structured dataset's manifest.

    Attributes
    ----------
    grid_shape : tuple of int
        (nx, ny[, nz]).
    order : {"preferred", "gmsh", "random"}
        Order of the nodes on the grid points: by position in space, by gmsh's number, or random.
    order_seed : int
        Seed of the random order.
    train, test : int
        Number of samples of each split.
    split_seed : int
    force, displacement : ComponentStatistics
        Statistics over the training split.
    source_digest : str
        Digest of the nodal dataset that it was made from.
    embedding : EmbeddingInfo or None
        Only of a grid that is embedded on its mesh.
    stiffness : str or None
        SHA-256 of the stiffness file; absent from the file if the dataset has none.
    """

    grid_shape: tuple[int, ...]
    order: NodeOrder = "preferred"
    order_seed: int = 0
    train: int
    test: int
    split_seed: int
    force: ComponentStatistics
    displacement: ComponentStatistics
    source_digest: str
    embedding: EmbeddingInfo | None = None
    stiffness: str | None = Field(None, pattern=r"^[0-9a-f]{64}$", exclude_if=absent)


class Stage(Frozen):
    """A dataset as it was before it has grown by further samples of the same case.

    Attributes
    ----------
    samples, failed : int
        Number of solved samples, and of failed load cases. They have the lowest sample numbers.
    case_digest : str
        SHA-256 of the case configuration, which had fewer samples.
    software : dict
        Versions of the software that made its samples.
    digest : str
        Digest of its manifest.
    """

    samples: int = Field(ge=0)
    failed: int = Field(ge=0)
    case_digest: str
    software: dict[str, str]
    digest: str


class Manifest(Frozen):
    """A dataset's manifest.

    Attributes
    ----------
    schema_version : int
    kind : {"nodal", "structured"}
    name : str
        Name of the case.
    case : dict
        The whole case configuration.
    case_digest : str
        SHA-256 of the case configuration.
    seed : int
    units : dict
    software : dict
        Versions of the software that made the dataset.
    dimension : int
        Number of space dimensions d.
    samples, failed : int
        Number of solved samples, and of failed load cases, over all shards.
    transforms : tuple of dict
        Steps that changed the samples after they were solved (noise), with all their settings.
    history : tuple of Stage
        The dataset before each time that it has grown; absent from the file if it never has.
    shards : tuple of ShardEntry
    structured : StructuredInfo or None
    stiffness : str or None
        SHA-256 of the stiffness file of a nodal dataset; absent from the file if it has none. A
        structured dataset has it in `structured`.
    solver : SolverRecord or None
        How the load cases were solved; absent from the file if it is not known.
    forces : "consistent" or None
        Of elements with points between the nodes: distributed loads and pressures act on all their
        points. Absent from the file if the nodes are all points, and of datasets of earlier
        versions, whose distributed loads and pressures act on the corners of the cells alone.
    digest : str
        SHA-256 of everything above.
    """

    schema_version: int = Field(SCHEMA_VERSION, ge=SCHEMA_VERSION, le=SCHEMA_VERSION)
    kind: Kind
    name: str
    case: dict[str, Any]
    case_digest: str
    seed: int
    units: dict[str, str] = UNITS
    software: dict[str, str]
    dimension: int = Field(ge=2, le=3)
    samples: int = Field(ge=0)
    failed: int = Field(ge=0)
    transforms: tuple[dict[str, Any], ...] = ()
    history: tuple[Stage, ...] = Field((), exclude_if=lambda stages: not stages)
    shards: tuple[ShardEntry, ...]
    structured: StructuredInfo | None = None
    stiffness: str | None = Field(None, pattern=r"^[0-9a-f]{64}$", exclude_if=absent)
    solver: SolverRecord | None = Field(None, exclude_if=absent)
    forces: Literal["consistent"] | None = Field(None, exclude_if=absent)
    digest: str = ""

    @property
    def stiffness_checksum(self) -> str | None:
        """SHA-256 of the stiffness file of either kind of dataset; None if it has none."""
        return self.stiffness if self.structured is None else self.structured.stiffness

    @property
    def case_digests(self) -> set[str]:
        """Digests of the case that shards may have: the manifest's, and those of its history."""
        return {self.case_digest, *(stage.case_digest for stage in self.history)}

    def sealed(self) -> Manifest:
        """Return a copy with its own digest filled in."""
        return self.model_copy(update={"digest": digest_of(self._content())})

    def is_intact(self) -> bool:
        """True if the digest is that of the content."""
        return self.digest == digest_of(self._content())

    def spelled(self) -> str:
        """Text of the manifest file, in its one canonical spelling."""
        return json.dumps(self.model_dump(mode="json"), indent=1, ensure_ascii=True) + "\n"

    def _content(self) -> dict[str, Any]:
        return self.model_dump(mode="json", exclude={"digest"})


def digest_of(content: Any) -> str:
    """SHA-256 of plain data in canonical JSON (sorted keys, no white space)."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def write_manifest(folder: Path, manifest: Manifest) -> Manifest:
    """Seal a manifest and write it atomically into the dataset's folder; return it sealed."""
    sealed = manifest.sealed()
    write_text(folder / MANIFEST, sealed.spelled())
    return sealed


def require_dataset(folder: Path) -> None:
    """Refuse a folder that holds no dataset: none with a manifest, damaged or not.

    Raises
    ------
    InputError
        If the folder or its manifest is missing, or the dataset is not finished.
    """
    if (folder / MANIFEST).is_file():
        return
    unfinished = find_unfinished(folder)
    if unfinished is not None:
        raise InputError(
            f"{folder}: unfinished, {unfinished.finished} of {unfinished.shards} shards; "
            f"{unfinished.how_to_go_on}"
        )
    what = "no such dataset" if not folder.is_dir() else f"no {MANIFEST} in it"
    raise InputError(f"{folder}: {what}; expected a dataset made by datagen")


def read_manifest(folder: Path, kind: Kind | None = None) -> Manifest:
    """Read the manifest of a dataset and check it against its own digest.

    Parameters
    ----------
    folder : Path
        The dataset.
    kind : {"nodal", "structured"}, optional
        Kind that the caller needs.

    Raises
    ------
    InputError
        If the folder or its manifest is missing, unfinished, damaged, or of another kind.
    """
    path = folder / MANIFEST
    require_plain(folder, path)
    require_dataset(folder)
    try:
        text = path.read_text(encoding="ascii")
        content = json.loads(text)
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid JSON ({error})") from None
    manifest = validate(Manifest, content, str(path))
    if not manifest.is_intact() or manifest.spelled() != text:
        raise InputError(f"{path}: damaged, its content does not match its digest")
    if kind is not None and manifest.kind != kind:
        raise InputError(f"{folder}: a {manifest.kind} dataset, expected a {kind} one")
    return manifest


JOURNAL = ".journal"


@dataclass(frozen=True)
class Unfinished:
    """A dataset whose samples are still being made, or that a killed run has left.

    Attributes
    ----------
    folder : Path
    samples : int
        Number of load cases of the whole dataset.
    shards, finished : int
        Number of all its shards, and of those that are finished since the run began.
    program : str
        Command that makes it.
    """

    folder: Path
    samples: int
    shards: int
    finished: int
    program: str = "datagen run"

    @property
    def how_to_go_on(self) -> str:
        """Say how the dataset is finished."""
        return f"run the same `{self.program} … --out {self.folder}` again"


def growing(unfinished: Unfinished) -> str:
    """Say that a complete dataset grows, and how that is finished."""
    return f"grows to {unfinished.samples} samples, unfinished; {unfinished.how_to_go_on}"


def find_unfinished(folder: Path) -> Unfinished | None:
    """Read the journal of a folder; None if it has none that can be read."""
    journal = folder / JOURNAL
    try:
        content = json.loads((journal / "case.json").read_text(encoding="utf-8"))
        samples, size = (int(content["dataset"][key]) for key in ("samples", "shard_size"))
        finished = sum(1 for entry in journal.glob("shard-*.json"))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    program = str(content.get("program", Unfinished.program))
    return Unfinished(folder, samples, -(-samples // max(size, 1)), finished, program)
