"""The strain energy of a user's own material, as UFL."""

from __future__ import annotations

from typing import Any

import ufl

from datagen.materials.own_material import OwnMaterial
from datagen.own_class import described, source_of
from shared_schema.common.errors import InputError


def own_energy(f: Any, material: OwnMaterial) -> Any:
    """W(F) in J/m³ from F, (3, 3); InputError if the method raises, or returns no scalar."""
    try:
        energy = ufl.as_ufl(material.energy(f))
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:
        said = described(error, source_of(material))
        raise InputError(f"model '{material.model}': energy: {said}") from None
    if energy.ufl_shape != () or energy.ufl_free_indices != ():
        raise InputError(
            f"model '{material.model}': energy has shape {energy.ufl_shape}, expected a scalar"
        )
    return energy
