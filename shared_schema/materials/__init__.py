r"""The materials that a case can name, with their strain energies W in J per m³.

A material is hyperelastic. The formula of its energy stands here once, as a function of invariants
(`Invariants`) in plain arithmetic (`Material.energy`); UFL and PyTorch both evaluate it, and its
stiffness at rest follows from it.
"""

from shared_schema.materials.at_rest import AtRest, at_rest
from shared_schema.materials.fibre_reinforced import Guccione, HolzapfelGasserOgden
from shared_schema.materials.fibres import FibreFile, FibreReinforced, Fibres, WithFibres
from shared_schema.materials.isotropic import (
    VOLUMETRIC_TERMS,
    NeoHookean,
    StVenantKirchhoff,
    Volumetric,
    VolumetricTerm,
    YoungPoisson,
)
from shared_schema.materials.material import LARGEST_MODULUS, Material
from shared_schema.materials.ogden import Ogden, trace_of_power
from shared_schema.materials.own_material import OwnMaterial, RecordedMaterial
from shared_schema.materials.reading import (
    SHIPPED,
    Materials,
    as_tuple,
    material_of,
    materials_of,
    ratio_at_rest,
    shipped_material,
)
from shared_schema.materials.rubber_like import ArrudaBoyce, Gent, MooneyRivlin, RubberLike, Yeoh
from shared_schema.materials.signature import (
    ARRAYS,
    ZERO,
    FibreInvariants,
    Functions,
    Invariants,
    Scalar,
)

ShippedMaterial = Material

__all__ = [
    "ARRAYS",
    "LARGEST_MODULUS",
    "SHIPPED",
    "VOLUMETRIC_TERMS",
    "ZERO",
    "ArrudaBoyce",
    "AtRest",
    "FibreFile",
    "FibreInvariants",
    "FibreReinforced",
    "Fibres",
    "Functions",
    "Gent",
    "Guccione",
    "HolzapfelGasserOgden",
    "Invariants",
    "Material",
    "Materials",
    "MooneyRivlin",
    "NeoHookean",
    "Ogden",
    "OwnMaterial",
    "RecordedMaterial",
    "RubberLike",
    "Scalar",
    "ShippedMaterial",
    "StVenantKirchhoff",
    "Volumetric",
    "VolumetricTerm",
    "WithFibres",
    "Yeoh",
    "YoungPoisson",
    "as_tuple",
    "at_rest",
    "material_of",
    "materials_of",
    "ratio_at_rest",
    "shipped_material",
    "trace_of_power",
]
