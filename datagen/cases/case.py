"""Configuration of a case: geometry, material, supports, loads, solver and dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import (
    Field,
    SerializeAsAny,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    field_validator,
    model_serializer,
)

from datagen.cases.dataset_settings import DatasetSettings
from datagen.discretisation.element import Element
from datagen.loads import LoadFamily, load_family
from datagen.mesh.geometry import Geometry
from datagen.mesh.mesh_file import MeshFile
from datagen.mesh.regions import Region
from datagen.solver.settings import SolverSettings
from shared_schema.common.configuration import Frozen, read_named, validate
from shared_schema.common.errors import InputError
from shared_schema.manifest import digest_of
from shared_schema.material import NeoHookean, Volumetric

SHIPPED = Path(__file__).parents[1] / "configs"


class Case(Frozen):
    """Configuration of a case; it determines the dataset.

    Attributes
    ----------
    name : str
    mesh : Box, LShape or MeshFile
    material : NeoHookean
    element : {"linear", "quadratic", "incompressible"}
        Kind of the finite elements.
    supports : tuple of Region
        Regions whose nodes are clamped.
    load : LoadFamily
    solver : SolverSettings
    dataset : DatasetSettings
    """

    name: str = Field(pattern=r"^[A-Za-z0-9_.-]+$", max_length=100)
    mesh: Geometry
    material: NeoHookean
    element: Element = "linear"
    supports: tuple[Region, ...] = Field(min_length=1)
    load: SerializeAsAny[LoadFamily]
    solver: SolverSettings = SolverSettings()
    dataset: DatasetSettings

    @model_serializer(mode="wrap")
    def _without_linear_element(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out linear elements, so that cases without the key keep their digest."""
        content: dict[str, Any] = plain(self)
        if self.element == "linear":
            del content["element"]
        return content

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

    Raises
    ------
    InputError
        If there is no such case, or a key or value in it is wrong.
    """
    content, source = read_named(name, SHIPPED, "case")
    for section, key, value in (
        ("material", "volumetric", volumetric),
        ("dataset", "samples", samples),
    ):
        if value is not None and isinstance(content.get(section), dict):
            content[section][key] = value
    folder = Path(source).parent
    case = validate(Case, content, source, context=folder)
    if isinstance(case.mesh, MeshFile):
        try:
            mesh = case.mesh.found_from(folder, trust)
        except InputError as error:
            raise InputError(f"{source}: {error}") from None
        case = case.model_copy(update={"mesh": mesh})
    return case
