"""Materials from the ``material`` section of a case: shipped ones, or of a user's own file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from datagen.materials.own_material import OwnMaterial
from datagen.own_class import import_named
from shared_schema.common.configuration import first_problem
from shared_schema.material import SHIPPED, Material, shipped_material


def material_of(content: Any, folder: Path | None = None) -> Material:
    """Build the material that a section of a case names.

    Parameters
    ----------
    content : Any
        The section.
    folder : Path, optional
        Folder of the case file. Without one only shipped models are allowed, and nothing is
        imported.

    Raises
    ------
    ValueError
        If there is no such model, its file cannot be imported or has another checksum, or one of
        the keys is wrong.
    """
    name = content.get("model", "neo_hookean") if isinstance(content, dict) else None
    if not isinstance(name, str) or name in SHIPPED or ":" not in name:
        return shipped_material(content)
    made, digest = import_named("model", name, tuple(SHIPPED), OwnMaterial, folder)
    if content.get("model_sha256") not in (None, digest):
        raise ValueError(
            f"model '{name}': key 'model_sha256' = {content['model_sha256']!r}, "
            f"the file has {digest}"
        )
    try:
        built: Material = made.model_validate({**content, "model_sha256": digest})
    except ValidationError as error:
        raise ValueError(f"{first_problem(error)} (model '{name}')") from None
    return built
