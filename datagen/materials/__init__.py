"""Materials of a case: the shipped ones, and a user's own strain energy."""

from shared_schema.materials import OwnMaterial, material_of

__all__ = ["OwnMaterial", "material_of"]
