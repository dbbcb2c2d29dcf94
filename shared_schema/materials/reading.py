"""Materials from plain data: the shipped ones, by their names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

from pydantic import ValidationError

from shared_schema.common.configuration import first_problem
from shared_schema.common.errors import InputError
from shared_schema.materials.fibre_reinforced import (
    FibreFile,
    Guccione,
    HolzapfelGasserOgden,
    WithFibres,
)
from shared_schema.materials.isotropic import (
    ArrudaBoyce,
    Gent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    StVenantKirchhoff,
    Yeoh,
)
from shared_schema.materials.material import Material
from shared_schema.materials.own_material import OwnMaterial, RecordedMaterial, with_record
from shared_schema.own_class import import_named

Materials: TypeAlias = Material | tuple[Material, ...]
SHIPPED: dict[str, type[Material]] = {
    "neo_hookean": NeoHookean,
    "st_venant_kirchhoff": StVenantKirchhoff,
    "mooney_rivlin": MooneyRivlin,
    "yeoh": Yeoh,
    "gent": Gent,
    "ogden": Ogden,
    "arruda_boyce": ArrudaBoyce,
    "holzapfel_gasser_ogden": HolzapfelGasserOgden,
    "guccione": Guccione,
}


def material_of(content: Any, folder: Path | None = None) -> Material:
    """Build the material that a section of a case names, shipped or of a user's own file.

    Parameters
    ----------
    content : Any
        The section.
    folder : Path, optional
        Folder of the case file. Without one only shipped models are allowed, and nothing is
        imported or read.

    Raises
    ------
    ValueError
        If there is no such model, a file of it cannot be read or has another checksum, or one of
        the keys is wrong.
    """
    name = content.get("model", "neo_hookean") if isinstance(content, dict) else None
    if not isinstance(name, str) or name in SHIPPED or ":" not in name:
        return _with_files(shipped_material(content), folder)
    made, digest = import_named("model", name, tuple(SHIPPED), OwnMaterial, folder)
    if content.get("model_sha256") not in (None, digest):
        raise ValueError(
            f"model '{name}': key 'model_sha256' = {content['model_sha256']!r}, "
            f"the file has {digest}"
        )
    try:
        own: OwnMaterial = made.model_validate({**content, "model_sha256": digest})
    except ValidationError as error:
        problem = first_problem(error)
        named = "" if f"'{name}'" in problem else f" (model '{name}')"
        raise ValueError(problem + named) from None
    return _with_files(with_record(own), folder)


def _with_files(material: Material, folder: Path | None) -> Material:
    """Copy a material with its file of directions found from the folder of the case file."""
    if folder is None or not isinstance(material, WithFibres):
        return material
    if not isinstance(material.fibres, FibreFile):
        return material
    return material.model_copy(update={"fibres": material.fibres.found_from(folder)})


def shipped_material(content: Any) -> Material:
    """Build a material from plain data; ValueError if it is none of the shipped ones, or wrong."""
    if not isinstance(content, dict):
        raise ValueError("expected a mapping of the material's keys")
    name = content.get("model", "neo_hookean")
    if not isinstance(name, str) or name not in SHIPPED:
        raise ValueError(f"key 'model' = {name!r}: expected one of {', '.join(SHIPPED)}")
    try:
        return SHIPPED[name].model_validate(content)
    except ValidationError as error:
        raise ValueError(first_problem(error)) from None


def materials_of(content: Any, source: str) -> Materials:
    """Build the material, or the materials of the groups, that the case of a dataset names.

    A user's own ones are those of their recorded energies; no file is imported or read.

    Parameters
    ----------
    content : Any
        Content of the key ``material``: a mapping, or a list of some, one a group.
    source : str
        Origin of the content, for the error message.

    Raises
    ------
    InputError
        If a material is none of the shipped ones, nor one with a recorded energy, or is wrong.
    """
    try:
        if isinstance(content, (list, tuple)) and content:
            return tuple(_stored_material(each) for each in content)
        return _stored_material(content)
    except ValueError as error:
        raise InputError(f"{source}: {error}") from None


def _stored_material(content: Any) -> Material:
    """Build a material from a dataset's manifest; ValueError as `shipped_material`."""
    if not (isinstance(content, dict) and ":" in str(content.get("model", ""))):
        return shipped_material(content)
    try:
        return RecordedMaterial.model_validate(content)
    except ValidationError as error:
        raise ValueError(first_problem(error)) from None


def as_tuple(materials: Materials | Sequence[Material]) -> tuple[Material, ...]:
    """Return one material or several as a tuple."""
    return (materials,) if isinstance(materials, Material) else tuple(materials)


def ratio_at_rest(material: Material) -> float:
    """Poisson's ratio ν = λ / (2 (λ + μ)) of the undeformed body."""
    return material.lame_lambda / (2 * (material.lame_lambda + material.lame_mu))
