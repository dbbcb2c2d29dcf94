r"""First and second variation of a strain energy, by the chain rule through its invariants.

With the invariants :math:`x_k(u)` of an energy density :math:`W(x_1, x_2, …)`, and
:math:`δ` and :math:`Δ` the variations by test and trial functions,

.. math::
    δW = \sum_k \frac{∂W}{∂x_k} \, δx_k, \qquad
    Δ δW = \sum_{kl} \frac{∂^2 W}{∂x_k ∂x_l} \, δx_k \, Δx_l
           + \sum_k \frac{∂W}{∂x_k} \, Δ δx_k .

The derivatives of W are scalars without arguments. UFL would carry test and trial functions through
every operation of W instead, which takes FFCx minutes where a formula is long (Ogden's).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import ufl
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.constantvalue import Zero

Expression = Any  # a UFL expression; ufl has no types


class Density(NamedTuple):
    """Strain energy density, as a UFL expression of variables.

    Attributes
    ----------
    value : UFL scalar
        W in J/m³.
    invariants : tuple of UFL variables
        x_k; none of an energy whose variations UFL derives itself.
    """

    value: Expression
    invariants: tuple[Expression, ...] = ()


class Variations(NamedTuple):
    """A scalar of a state with its variations, to be integrated.

    Attributes
    ----------
    value, first, second : UFL scalars
        Without arguments, with a test function, and with test and trial function.
    """

    value: Expression
    first: Expression
    second: Expression


def variations(density: Density, state: Any) -> Variations:
    """Derive the variations of an energy density by a state, a dolfinx.fem.Function."""
    space = state.function_space
    test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
    if not density.invariants:
        first = ufl.derivative(density.value, state, test)
        return Variations(density.value, first, ufl.derivative(first, state, trial))
    terms, first, second = [], [], []
    for variable in density.invariants:
        slope = _plain(ufl.diff(density.value, variable))
        if isinstance(slope, Zero):
            continue
        of_test, of_trial = (ufl.derivative(variable, state, v) for v in (test, trial))
        first.append(slope * of_test)
        second.append(slope * ufl.derivative(of_test, state, trial))
        terms.append((variable, slope, of_test, of_trial))
    for variable, _, _, of_trial in terms:
        for _, slope, of_test, _ in terms:
            curvature = _plain(ufl.diff(slope, variable))
            if not isinstance(curvature, Zero):
                second.append(curvature * of_test * of_trial)
    return Variations(density.value, sum(first[1:], first[0]), sum(second[1:], second[0]))


def _plain(derivative: Expression) -> Expression:
    """Carry out the derivatives in an expression."""
    return apply_derivatives(apply_algebra_lowering(derivative))
