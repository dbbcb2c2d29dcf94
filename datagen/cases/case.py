"""Configuration of a case: geometry, material, supports, loads, solver and dataset."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, SerializeAsAny, ValidationInfo, field_validator, model_validator

from datagen.discretisation.element import Element
from datagen.mesh.geometries import Geometry
from datagen.mesh.mesh_file import MeshFile
from datagen.solver.settings import SolverSettings
from shared_schema.actuators import Cable, Chamber, actuators_of
from shared_schema.common.arguments import checked_arguments
from shared_schema.common.configuration import (
    Frozen,
    absent,
    changed,
    read_named,
    shipped_files,
    source_of,
    validate,
)
from shared_schema.common.errors import InputError
from shared_schema.common.units import SI, Units
from shared_schema.load_cases import read_load_cases
from shared_schema.loads import LoadFamily, load_family
from shared_schema.loads.regions import AXES, Region
from shared_schema.manifest import digest_of
from shared_schema.materials import Material, Volumetric, material_of
from shared_schema.motion import TimeSettings, densities_of_cells
from shared_schema.samples.dataset_settings import DatasetSettings

Axis = Literal["x", "y", "z"]
SHIPPED = Path(__file__).parents[1] / "configs"


class Support(Region):
    """Region whose nodes do not move, or slide.

    Attributes
    ----------
    components : tuple of "x", "y", "z", optional
        Components of the displacement that are held at zero; all by default. Those of a symmetry
        plane x = 0 are [x].
    """

    components: tuple[Axis, ...] | None = Field(None, min_length=1, exclude_if=absent)

    @field_validator("components")
    @classmethod
    def _are_different(cls, value: tuple[Axis, ...] | None) -> tuple[Axis, ...] | None:
        if value is not None and len(set(value)) != len(value):
            raise ValueError("expected each component once")
        return value

    def holds(self, dimension: int) -> NDArray[np.bool_]:
        """Components that are held, (d,)."""
        return np.array([self.components is None or a in self.components for a in AXES[:dimension]])


class Case(Frozen):
    """Configuration of a case; it determines the dataset.

    Attributes
    ----------
    name : str
        Name of the case; configurations of networks name it too.
    mesh : Box, LShape or MeshFile
        Geometry and its mesh.
    material : Material, or tuple of some
        Material of the whole body; several are those of groups of cells.
    element : {"linear", "quadratic", "incompressible"}
        Kind of the finite elements.
    supports : tuple of Support
        Regions whose nodes are clamped, or held in some components.
    load : LoadFamily, or tuple of some
        Family of loads, of which every sample draws one; several act at once. There may be none
        beside actuators.
    actuators : mapping of str to Cable or Chamber, optional
        Cables and chambers by their names.
    solver : SolverSettings
        Newton's method, linear solver and load stepping.
    dataset : DatasetSettings
        Number of samples, seed, shards and split.
    units : Units
        Labels of the units that all numbers are in; nothing is converted.
    time : TimeSettings, optional
        Time steps: the samples of the dataset are motions, not equilibria.
    """

    name: str = Field(pattern=r"^[A-Za-z0-9_.-]+$", max_length=100)
    mesh: Geometry
    material: SerializeAsAny[Material] | tuple[SerializeAsAny[Material], ...]
    element: Element = Field("linear", exclude_if=lambda element: element == "linear")
    supports: tuple[Support, ...] = Field(min_length=1)
    load: SerializeAsAny[LoadFamily] | tuple[SerializeAsAny[LoadFamily], ...] = ()
    actuators: dict[str, Cable | Chamber] | None = Field(None, exclude_if=absent)
    solver: SolverSettings = SolverSettings()
    dataset: DatasetSettings
    units: Units = Field(SI, exclude_if=lambda units: units == SI)
    time: TimeSettings | None = Field(None, exclude_if=absent)

    @field_validator("load", mode="before")
    @classmethod
    def _of_its_family(cls, value: Any, info: ValidationInfo) -> Any:
        """Build the families; the context is the folder of a case file, or None of a dataset."""
        return _each(value, lambda content: load_family(content, info.context))

    @field_validator("material", mode="before")
    @classmethod
    def _of_its_model(cls, value: Any, info: ValidationInfo) -> Any:
        """Build the materials, with the same context."""
        return _each(value, lambda content: material_of(content, info.context))

    @field_validator("supports", mode="before")
    @classmethod
    def _hold_the_body(cls, value: Any) -> Any:
        if value == ():
            raise ValueError("the body can move and turn freely, expected a list of at least one")
        return value

    @field_validator("actuators", mode="before")
    @classmethod
    def _of_their_kinds(cls, value: Any) -> Any:
        return None if value is None else actuators_of(value)

    @model_validator(mode="after")
    def _is_driven(self) -> Case:
        if self.load == () and not self.actuators:
            raise ValueError("key 'load': expected a mapping, a list of at least one, or actuators")
        return self

    @model_validator(mode="after")
    def _has_masses(self) -> Case:
        if self.time is not None:
            try:
                densities_of_cells(self.material, None, 0)
            except InputError as error:
                raise ValueError(str(error)) from None
        return self

    @field_validator("material")
    @classmethod
    def _is_not_empty(cls, value: Any) -> Any:
        if value == ():
            raise ValueError("expected a mapping, or a list of at least one")
        return value

    @field_validator("material")
    @classmethod
    def _each_of_its_group(cls, value: Any) -> Any:
        groups = [material.group for material in _several(value)]
        if isinstance(value, tuple) and (None in groups or len(set(groups)) != len(groups)):
            raise ValueError("expected a list of materials, each with another 'group'")
        if isinstance(value, Material) and value.group is not None:
            raise ValueError(f"'group' = '{value.group}': expected in a list of materials")
        return value

    @property
    def materials(self) -> tuple[Material, ...]:
        """All materials."""
        return _several(self.material)

    @property
    def loads(self) -> tuple[LoadFamily, ...]:
        """All load families."""
        return _several(self.load)

    def plain(self) -> dict[str, Any]:
        """The whole configuration as plain data, as the manifest stores it."""
        return self.model_dump(mode="json")

    def digest(self) -> str:
        """SHA-256 of the configuration."""
        return digest_of(self.plain())


CaseSource: TypeAlias = Case | str | Path | Mapping[str, Any]
Part = TypeVar("Part")


def _several(value: Part | tuple[Part, ...]) -> tuple[Part, ...]:
    return value if isinstance(value, tuple) else (value,)


def _each(value: Any, build: Callable[[dict[str, Any]], Any]) -> Any:
    """Build what a mapping stands for, or each mapping of a list."""
    if isinstance(value, dict):
        return build(value)
    if isinstance(value, tuple) and value:
        built = []
        for number, content in enumerate(value):
            if isinstance(content, Frozen):
                built.append(content)
                continue
            if not isinstance(content, dict):
                raise ValueError(f"part {number}: expected a mapping")
            try:
                built.append(build(content))
            except ValueError as error:
                before, key, rest = str(error).partition("key '")
                is_key = key and before in ("", "unknown ")
                said = f"{before}{key}{number}.{rest}" if is_key else f"part {number}: {error}"
                raise ValueError(said) from None
        return tuple(built)
    return value


@checked_arguments
def read_case(
    case: CaseSource,
    *,
    volumetric: Volumetric | None = None,
    samples: int | None = None,
    trust: bool = False,
    changes: Sequence[str] = (),
    loads: Path | str | None = None,
) -> Case:
    """Read a case from a YAML file, from plain data, or by the name of a shipped one.

    The files of a user's own load families and materials are imported.

    Parameters
    ----------
    case : str, Path, mapping or Case
        Path of a YAML file, name of a shipped case such as ``beam2d``, or the content of such a
        file, whose paths are then relative to the working directory. A `Case` is returned as it is.
    volumetric : {"paper", "quadratic"}, optional
        Replaces the material's volumetric term.
    samples : int, optional
        Replaces the number of samples.
    trust : bool
        Allow a gmsh script of the case to run programs and to write files.
    changes : sequence of str
        New values of keys, such as ``material.young_modulus=1e3`` (`changed`).
    loads : Path or str, optional
        File of load cases, all of which are solved instead of those that the case's family draws.
        Their nodes must lie in the region of that family.

    Raises
    ------
    InputError
        If there is no such case, a key or value in it is wrong, or another option is given for a
        `Case`.
    """
    if isinstance(case, Case):
        if volumetric or samples or changes or loads:
            raise InputError(f"case '{case.name}': is read already, expected no other values")
        return case
    if isinstance(case, Mapping):
        content, file = dict(case), "case"
    else:
        content, file = read_named(str(case), SHIPPED, "case")
    content, source = changed(content, changes), source_of(file, changes)
    for section, key, value in (
        ("material", "volumetric", volumetric),
        ("dataset", "samples", samples),
    ):
        if value is not None and isinstance(content.get(section), dict):
            content = {**content, section: {**content[section], key: value}}
    folder = Path(file).parent
    if loads is not None:
        count = len(read_load_cases(Path(loads)))
        if samples is not None:
            raise InputError(f"--samples {samples}: --loads '{loads}' has {count}, expected one")
        load = content["load"] if isinstance(content.get("load"), dict) else {}
        region = {"region": load["region"]} if "region" in load else {}
        given = {"family": "given", "file": str(Path(loads).resolve()), **region}
        dataset = {**dict(content.get("dataset") or {}), "samples": count}
        content = {**content, "load": given, "dataset": dataset}
    found = validate(Case, content, source, context=folder)
    if not isinstance(found.mesh, MeshFile):
        return found
    try:
        mesh = found.mesh.found_from(folder, trust)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    parts = found.model_dump_json(include={"material", "supports", "load", "actuators"})
    for name in found.mesh.zones:
        if f'"{name}"' not in parts and f' {name}"' not in parts:  # a group may be "volume NAME"
            raise InputError(
                f"{source}: key 'mesh.zones.{name}': no material, load or support names it, "
                f"expected materials of the groups '{name}' and 'rest'"
            )
    return found.model_copy(update={"mesh": mesh})


class ShippedCase(NamedTuple):
    """What one line says of a case.

    Attributes
    ----------
    name : str
    mesh : str
        Elements of a box, or the file.
    load : str
        Names of its load families.
    samples : int
    line : str
        What the case is.
    """

    name: str
    mesh: str
    load: str
    samples: int
    line: str


def shipped_cases() -> list[ShippedCase]:
    """List the cases that come with the package, by name."""
    return [
        ShippedCase(name, _mesh(case["mesh"]), _load(case), case["dataset"]["samples"], line)
        for name, case, line in shipped_files(SHIPPED)
    ]


def _load(case: dict[str, Any]) -> str:
    """Name the load families and actuators of a case."""
    load, actuators = case.get("load", []), case.get("actuators", {})
    families = [each["family"] for each in (load if isinstance(load, list) else [load])]
    return " + ".join([*families, *actuators])


def _mesh(mesh: dict[str, Any]) -> str:
    """Describe a mesh in few words: elements of a box, or the file."""
    if mesh["kind"] == "box":
        return " × ".join(map(str, mesh["elements"]))
    return str(mesh.get("path", mesh["kind"]))
