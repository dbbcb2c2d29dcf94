r"""Time steps: generalised-α, and the midpoint of the energy-momentum method.

A body moves as :math:`M a + R(u, v, t) = 0`, with

.. math:: R(u, v, t) = f_{int}(u) + f_v(u, v) + c M v - f_{ext}(u, t) .

A step h from u, v, a to u', v', a' is (Newmark 1959)

.. math::
    u' = u^* + β h^2 a', \quad u^* = u + h v + h^2 (\tfrac12 - β) a, \qquad
    v' = v^* + γ h a', \quad v^* = v + h (1 - γ) a .

**Generalised-α** (Chung and Hulbert 1993) with :math:`ρ = ρ_∞` weights forces, not states, so that
the body is in balance at u' itself:

.. math::
    (1-α_m) M a' + α_m M a + (1-α_f) R' + α_f R = 0, \\
    α_m = \frac{2ρ-1}{ρ+1}, \quad α_f = \frac{ρ}{ρ+1}, \quad
    γ = \tfrac12 - α_m + α_f, \quad β = \tfrac14 (1 - α_m + α_f)^2 .

**Energy-momentum** (Simo and Tarnow 1992): with :math:`α_m = α_f = 0`, :math:`β = \tfrac12` and
:math:`γ = 1` the same formulas are :math:`v' - v = h a'` and :math:`u' - u = h (v + v') / 2`, and
all forces are those between the two states: at the time t + h/2, with the velocity (v + v')/2.

Divided by :math:`1 - α_f`, both are a static equilibrium with springs :math:`A = k M`:

.. math::
    R_s(u') + f_v(u', v_d) + A (u' - u^*) + M g + r R(u, v, t) = 0, \qquad
    R_s = f_{int} - f_{ext}, \\
    k = \frac{1-α_m}{1-α_f} \frac{1}{β h^2} + c s, \qquad
    v_d = v^* + s (u' - u^*), \qquad
    g = \frac{α_m}{1-α_f} a + c v^*, \qquad
    r = \frac{α_f}{1-α_f} ,

where damping acts at the velocity :math:`v_d`, which is v' with :math:`s = γ / (β h)`, or the mean
of v and v' with :math:`s = 1 / h`. The first acceleration follows from
:math:`M a_0 = -R(u_0, v_0, 0)`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

State = Any  # an array or a tensor of any shape, the same for u, v and a


class Begun(NamedTuple):
    """What a step knows before it is taken.

    Attributes
    ----------
    u, v : array or tensor
        u* in m and v* in m/s: displacement and velocity at the end, were the acceleration there 0.
    g : array or tensor
        Acceleration in m/s² whose inertia M g acts besides.
    """

    u: State
    v: State
    g: State


@dataclass(frozen=True)
class Scheme:
    """Coefficients of a step.

    Attributes
    ----------
    step : float
        h in s.
    alpha_m, alpha_f, beta, gamma : float
    mass_damping : float
        c in 1/s.
    between : bool
        Forces are those between the two states (energy-momentum), not at the end.
    """

    step: float
    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    mass_damping: float = 0.0
    between: bool = False

    @classmethod
    def generalised_alpha(
        cls, step: float, dissipation: float, mass_damping: float = 0.0
    ) -> Scheme:
        """Scheme of a step h in s and ρ∞ in [0, 1]; 1 keeps high frequencies, 0 removes them."""
        alpha_m = (2 * dissipation - 1) / (dissipation + 1)
        alpha_f = dissipation / (dissipation + 1)
        shift = alpha_f - alpha_m
        return cls(step, alpha_m, alpha_f, (1 + shift) ** 2 / 4, 0.5 + shift, mass_damping)

    @classmethod
    def energy_momentum(cls, step: float, mass_damping: float = 0.0) -> Scheme:
        """Scheme that keeps energy and momenta, of a step h in s."""
        return cls(step, 0.0, 0.0, 0.5, 1.0, mass_damping, between=True)

    @property
    def acceleration_slope(self) -> float:
        """∂a'/∂u' = 1 / (β h²) in 1/s²."""
        return 1 / (self.beta * self.step**2)

    @property
    def velocity_slope(self) -> float:
        """∂v'/∂u' = γ / (β h) in 1/s."""
        return self.gamma / (self.beta * self.step)

    @property
    def damping_slope(self) -> float:
        """∂v_d/∂u' = s in 1/s, of the velocity at which damping acts."""
        return self.velocity_slope / 2 if self.between else self.velocity_slope

    @property
    def spring(self) -> float:
        """Stiffness of the springs A = k M over the mass: k in 1/s²."""
        inertia = (1 - self.alpha_m) / (1 - self.alpha_f) * self.acceleration_slope
        return inertia + self.mass_damping * self.damping_slope

    @property
    def carried(self) -> float:
        """Weight r of the last forces out of balance R(u, v, t)."""
        return self.alpha_f / (1 - self.alpha_f)

    def force_time(self, time: float) -> float:
        """Time in s at which external forces of the step from `time` act."""
        return time + (self.step / 2 if self.between else self.step)

    def begin(self, u: State, v: State, a: State) -> Begun:
        """Begin a step from displacement, velocity and acceleration."""
        h = self.step
        coasting = v + h * (1 - self.gamma) * a
        g = self.alpha_m / (1 - self.alpha_f) * a + self.mass_damping * coasting
        return Begun(u + h * v + h**2 * (0.5 - self.beta) * a, coasting, g)

    def pull(self, mass: Any, begun: Begun, left: State) -> State:
        """A ũ in N, by the mass matrix and the last forces out of balance R(u, v, t)."""
        return mass @ (self.spring * begun.u - begun.g) - self.carried * left

    def left(self, mass: Any, a: State, before: State, left: State) -> State:
        """R(u', v', t') in N at the end, by both accelerations and the last R(u, v, t)."""
        inertia = mass @ ((1 - self.alpha_m) * a + self.alpha_m * before)
        return -(inertia + self.alpha_f * left) / (1 - self.alpha_f)

    def velocity(self, begun: Begun, u: State) -> State:
        """Return v' in m/s at the end, by the displacement u' there."""
        return begun.v + self.velocity_slope * (u - begun.u)

    def damping_velocity(self, begun: Begun, u: State) -> State:
        """v_d in m/s at which damping acts, by the displacement u' at the end."""
        return begun.v + self.damping_slope * (u - begun.u)

    def acceleration(self, begun: Begun, u: State) -> State:
        """Return a' in m/s² at the end, by the displacement u' there."""
        return self.acceleration_slope * (u - begun.u)
