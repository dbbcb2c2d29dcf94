r"""Equilibrium of a body in the modes of a reduced network, in real time.

The displacement is that of the linear response :math:`u_1` and modes V. Its smooth part V a has the
least potential energy

.. math:: Π(a) = \sum_q w_q \, W(I + ∇V_q \, a) - g · a, \qquad g = V^T f

and what the modes cannot represent, such as the deformation around a loaded node, is that of the
linear response:

.. math:: u = u_1 + V (a - a_1), \qquad a_1 = Π''(0)^{-1} g.

The sum goes over a few quadrature points with weights of their own, a reduced cubature
(`cubature`); `least_energy` finds a from the network's coefficients, in loops that Numba compiles.
"""

from surrogate.mechanics.modal_equilibrium.cubature import Cubature, fit_cubature
from surrogate.mechanics.modal_equilibrium.least_energy import (
    BalancedCoefficients,
    ModalEquilibrium,
)

__all__ = ["BalancedCoefficients", "Cubature", "ModalEquilibrium", "fit_cubature"]
