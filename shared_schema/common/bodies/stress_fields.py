r"""Fields of stress from F, P and W, by their names in solution files.

=========================  ====================================================  =============
name                       meaning                                               unit
=========================  ====================================================  =============
``deformation_gradient``   F, (3, 3)                                             1
``first_piola``            :math:`P = ∂W/∂F`, (3, 3)                             Pa
``cauchy``                 :math:`σ = P F^T / J`, (3, 3)                         Pa
``von_mises``              :math:`\sqrt{3/2 \, s:s}`, :math:`s = σ - \tfrac13    Pa
                           \operatorname{tr}(σ) I`
``energy_density``         W                                                     J/m³
``jacobian``               :math:`J = \det F`                                    1
=========================  ====================================================  =============

They are those at the middle of each cell. Plane strain has :math:`F_{33} = 1` and a stress
:math:`σ_{33}`. The nodal field ``reaction`` holds the forces of the supports on the body, in N.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def stress_fields(f: Array, p: Array, w: Array) -> dict[str, Array]:
    """Derive all fields from F and P, (..., 3, 3), and W, (...).

    The Cauchy stress of an inverted cell (J ≤ 0) has no meaning.
    """
    j = np.linalg.det(f)
    with np.errstate(divide="ignore", invalid="ignore"):
        cauchy = p @ np.swapaxes(f, -1, -2) / j[..., None, None]
        deviator = cauchy - np.trace(cauchy, axis1=-2, axis2=-1)[..., None, None] / 3 * np.eye(3)
        von_mises = np.sqrt(1.5 * np.square(deviator).sum(axis=(-2, -1)))
    return {
        "deformation_gradient": f,
        "first_piola": p,
        "cauchy": cauchy,
        "von_mises": von_mises,
        "energy_density": w,
        "jacobian": j,
    }
