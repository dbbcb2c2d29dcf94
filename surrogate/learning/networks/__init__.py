"""Networks between fields: of a grid in scaled units, of a grid in SI units, and of a mesh.

`UNet` and `ReducedNetwork` map scaled forces to scaled displacements. `FieldNetwork` puts one of
them between forces in N and displacements in m on the grid, with the response of the body inside if
the configuration says so. `NodalNetwork` adds the maps between grid and nodes.
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.learning.networks.field_network import FieldNetwork, parameter_count
    from surrogate.learning.networks.unet import UNet, UNetConfig

__all__ = [
    "FieldNetwork",
    "UNet",
    "UNetConfig",
    "parameter_count",
]
__getattr__, __dir__ = lazy_names(__name__)
