"""Materials of a case: the shipped ones, and a user's own strain energy W(F)."""

from datagen.materials.own_material import OwnMaterial
from datagen.materials.reading import material_of

__all__ = ["OwnMaterial", "material_of"]
