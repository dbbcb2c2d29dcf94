"""Configuration of a case: geometry, material, supports, loads, solver and dataset."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import Field, SerializeAsAny, ValidationInfo, field_validator

from datagen.cases.dataset_settings import DatasetSettings
from datagen.loads import LoadFamily, load_family
from datagen.mesh.geometry import Geometry
from datagen.mesh.mesh_file import MeshFile
from datagen.mesh.regions import Region
from datagen.solver.settings import SolverSettings
from shared_schema.common.changed_keys import changed, source_of
from shared_schema.common.configuration import Frozen, read_named, validate
from shared_schema.common.errors import InputError
from shared_schema.load_cases import read_load_cases
from shared_schema.manifest import digest_of
from shared_schema.material import NeoHookean, Volumetric

SHIPPED = Path(__file__).parents[1] / "configs"


class Case(Frozen):
    """Configuration of a case; it determines the dataset.

    Attributes
    ----------
    name : str
        Name of the case; configurations of networks name it too.
    mesh : Box, LShape or MeshFile
        Geometry and its mesh.
    material : NeoHookean
        Material of the whole body.
    supports : tuple of Region
        Regions whose nodes are clamped.
    load : LoadFamily
        Family of loads, of which every sample draws one.
    solver : SolverSettings
        Newton's method, linear solver and load stepping.
    dataset : DatasetSettings
        Number of samples, seed, shards and split.
    """

    name: str = Field(pattern=r"^[A-Za-z0-9_.-]+$", max_length=100)
    mesh: Geometry
    material: NeoHookean
    supports: tuple[Region, ...] = Field(min_length=1)
    load: SerializeAsAny[LoadFamily]
    solver: SolverSettings = SolverSettings()
    dataset: DatasetSettings

    @field_validator("load", mode="before")
    @classmethod
    def _of_its_family(cls, value: Any, info: ValidationInfo) -> Any:
        """Build the family; the context is the folder of a case file, or None of a dataset."""
        return load_family(value, info.context) if isinstance(value, dict) else value

    def plain(self) -> dict[str, Any]:
        """The whole configuration as plain data, as the manifest stores it."""
        return self.model_dump(mode="json")

    def digest(self) -> str:
        """SHA-256 of the configuration."""
        return digest_of(self.plain())


def read_case(
    name: str,
    volumetric: Volumetric | None = None,
    samples: int | None = None,
    trust: bool = False,
    changes: Sequence[str] = (),
    loads: Path | None = None,
) -> Case:
    """Read a case from a YAML file, or by the name of a shipped one.

    The file of a user's own load family is imported.

    Parameters
    ----------
    name : str
        Path of a YAML file, or name of a shipped case such as ``beam2d``.
    volumetric : {"paper", "quadratic"}, optional
        Replaces the material's volumetric term.
    samples : int, optional
        Replaces the number of samples.
    trust : bool
        Allow a gmsh script of the case to run programs and to write files.
    changes : sequence of str
        New values of keys, such as ``material.young_modulus=1e3`` (`changed`).
    loads : Path, optional
        File of load cases, all of which are solved instead of those that the case's family draws.
        Their nodes must lie in the region of that family.

    Raises
    ------
    InputError
        If there is no such case, or a key or value in it is wrong.
    """
    content, file = read_named(name, SHIPPED, "case")
    content, source = changed(content, changes), source_of(file, changes)
    for section, key, value in (
        ("material", "volumetric", volumetric),
        ("dataset", "samples", samples),
    ):
        if value is not None and isinstance(content.get(section), dict):
            content = {**content, section: {**content[section], key: value}}
    folder = Path(file).parent
    if loads is not None:
        count = len(read_load_cases(loads))
        if samples is not None:
            raise InputError(f"--samples {samples}: --loads '{loads}' has {count}, expected one")
        region = content["load"].get("region") if isinstance(content.get("load"), dict) else None
        given = {"family": "given", "file": str(loads.resolve()), "region": region}
        dataset = {**dict(content.get("dataset") or {}), "samples": count}
        content = {**content, "load": given, "dataset": dataset}
    case = validate(Case, content, source, context=folder)
    if isinstance(case.mesh, MeshFile):
        try:
            mesh = case.mesh.found_from(folder, trust)
        except InputError as error:
            raise InputError(f"{source}: {error}") from None
        case = case.model_copy(update={"mesh": mesh})
    return case
