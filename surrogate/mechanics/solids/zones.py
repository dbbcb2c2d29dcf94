r"""Neo-Hookean bodies whose zones differ in Young's modulus alone.

With one Poisson's ratio and one volumetric term, the energy of a zone is proportional to its
modulus. With the energy :math:`W_0` of the first zone,

.. math:: E(u) = \sum_q w_q \frac{E_q}{E_0} W_0(F_q),

so that such a body is one of a single material whose quadrature points have other weights.
"""

from __future__ import annotations

import torch
from torch import Tensor

from shared_schema.materials import Materials, NeoHookean, as_tuple
from surrogate.mechanics.solids.solid import Solid

__all__ = ["material_of_zones", "weights_of_zones"]


def material_of_zones(material: Materials) -> NeoHookean | None:
    """The material of the first zone, or the only one; None of bodies of another kind."""
    first, *others = as_tuple(material)
    if not isinstance(first, NeoHookean):
        return None
    for other in others:
        if not isinstance(other, NeoHookean):
            return None
        changed = {"young_modulus": first.young_modulus, "group": first.group}
        if other.model_copy(update=changed) != first:
            return None
    return first


def weights_of_zones(solid: Solid) -> Tensor:
    """Weights :math:`w_q E_q / E_0` of the quadrature points in m³ (m² in the plane).

    Parameters
    ----------
    solid : Solid
        Of which `material_of_zones` knows the material.

    Returns
    -------
    Tensor, (n_cells, n_points)
    """
    if len(solid.materials) == 1:
        return solid.volumes
    moduli = [each.young_modulus for each in solid.materials if isinstance(each, NeoHookean)]
    ratios = torch.tensor(moduli, dtype=solid.volumes.dtype) / moduli[0]
    return solid.volumes * ratios[solid.material_of_cells()].to(solid.volumes.device)[:, None]
