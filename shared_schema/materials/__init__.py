r"""The materials that a case can name, with their strain energies W in J per m³.

A material is hyperelastic. The formula of its energy stands here once, as a function of invariants
(`Invariants`) in plain arithmetic (`Material.energy`); UFL and PyTorch both evaluate it, and its
stiffness at rest follows from it.
"""

from shared_schema.materials.fibre_reinforced import (
    FibreFile,
    FibreReinforced,
    Fibres,
    Guccione,
    HolzapfelGasserOgden,
    WithFibres,
)
from shared_schema.materials.isotropic import (
    VOLUMETRIC_TERMS,
    ArrudaBoyce,
    Gent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    RubberLike,
    StVenantKirchhoff,
    Volumetric,
    VolumetricTerm,
    Yeoh,
    YoungPoisson,
    trace_of_power,
)
from shared_schema.materials.locking import LARGEST_RATIO, locking_warning, locks
from shared_schema.materials.material import (
    ARRAYS,
    LARGEST_MODULUS,
    ZERO,
    AtRest,
    FibreInvariants,
    Functions,
    Invariants,
    Material,
    Scalar,
    at_rest,
)
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

ShippedMaterial = Material

__all__ = [
    "ARRAYS",
    "LARGEST_MODULUS",
    "LARGEST_RATIO",
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
    "locking_warning",
    "locks",
    "material_of",
    "materials_of",
    "ratio_at_rest",
    "shipped_material",
    "trace_of_power",
]
