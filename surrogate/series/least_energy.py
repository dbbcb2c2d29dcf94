r"""The combination of the terms of a series that has the least potential energy.

.. math::
    u = \sum_{k=1}^n c_k u_k, \qquad Π(c) = E(u) - f · u \to \min

All cₖ = 1 give the sum of the series, which converges slowly under large loads, if at all. What the
terms span is much better than their sum: it is the reduced basis of A. K. Noor and J. M. Peters
(*Reduced basis technique for nonlinear analysis of structures*, AIAA Journal 18, 1980).

With the displacement gradients Hₖ of the terms, e = J - 1 is a polynomial of c
(`surrogate.series.jacobian`) that begins with :math:`c_k \, \mathrm{tr} H_k`. So the
energy of the Neo-Hookean solid (`surrogate.mechanics.solids.deformation`) is, with sums over the
quadrature points,

.. math::
    Π = \sum_q w_q (\tfrac{g}{2} e^2 + d (e - \ln (1 + e)))
        + \tfrac{μ}{2} M_{kl} c_k c_l - μ N(c) - a_k c_k, \qquad
    M_{kl} = \sum_q w_q H_k : H_l, \quad N = \sum_q w_q (e - c_k \, \mathrm{tr} H_k).

with the factors g and d of the volumetric term (`surrogate.series.stress_series.Factors`). All of
it is of second order in the gradients, so that nothing is lost where they are small. The works
aₖ = f·uₖ are the first row of the Hessian at c = 0, since f = K u₁ and g + d = λ + μ:

.. math::
    a_k = \sum_q w_q (μ H_1 : H_k - μ \, (I × H_1) : H_k
        + (λ + μ) \, \mathrm{tr} H_1 \, \mathrm{tr} H_k).

Newton's method minimises Π, from terms that fade where they do not decrease, under half of the load
as long as Π is infinite there. A step that raises Π is not taken; the next one is tried with a
larger shift of the Hessian (Levenberg, Marquardt). What there is at every quadrature point has the
precision of the gradients; c and the sums are double. This is for batches of loads, on any device
and in exported files; `surrogate.series.compiled_energy` does the same for one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf
from typing import NamedTuple

import torch
from torch import Tensor
from torch._higher_order_ops.while_loop import while_loop  # not public yet

from shared_schema.materials import NeoHookean
from surrogate.cuda_graphs import Replayed
from surrogate.series.jacobian import JacobianPolynomial
from surrogate.series.stress_series import Factors

EVALUATIONS = 30  # of Π, at most
SMALLEST_SHIFT, SECOND_SHIFT, GROWTH = 1e-9, 1e-3, 10.0  # relative to the stiffness of every term
SMALLEST_J = 1e-6
GRAPHS = 16  # that are kept, of batches on a GPU
ROUNDING = 2.0**12  # of Π, relative, in units of the rounding of a number
SMALL_STEP, SMALLEST_STEP = 3e-3, 1e-10  # relative to the last term, and to the first one
TINY = 1e-60  # no division by zero; energies are those of volumes of about 1


class State(NamedTuple):
    """Π and its derivatives at some coefficients, in double precision.

    Attributes
    ----------
    c : Tensor, (…, n)
    energy : Tensor, (…)
        In J.
    gradient, hessian : Tensor, (…, n), (…, n, n)
    """

    c: Tensor
    energy: Tensor
    gradient: Tensor
    hessian: Tensor


class Search(NamedTuple):
    """Where the search of the least Π is: a state, and the step to the next one.

    Attributes
    ----------
    c, energy, gradient, hessian : Tensor
        As in `State`.
    shift : Tensor, (…)
        Of the Hessian.
    after : Tensor, (…, n)
        Coefficients after the step.
    is_last : Tensor, (…)
        Whether no step is needed after it.
    evaluations : Tensor, ()
        Of Π, their number.
    """

    c: Tensor
    energy: Tensor
    gradient: Tensor
    hessian: Tensor
    shift: Tensor
    after: Tensor
    is_last: Tensor
    evaluations: Tensor

    def some(self, rows: Tensor) -> Search:
        """Return that of some loads of the batch."""
        parts = {name: each[rows] for name, each in self._asdict().items() if each.ndim}
        return self._replace(**parts)


class EnergyOfTerms(NamedTuple):
    """Π(c) in J, and its derivatives.

    Attributes
    ----------
    jacobian : JacobianPolynomial
    square, excess : Tensor, (n_points,)
        Factors g and d of the volumetric term, times the volumes of the points.
    squares, nonlinear : Tensor, (…, n, n), (…, n_monomials)
        μ Mₖₗ, and the coefficients of μ N(c), in J.
    works : Tensor, (…, n)
        aₖ in J.
    """

    jacobian: JacobianPolynomial
    square: Tensor
    excess: Tensor
    squares: Tensor
    nonlinear: Tensor
    works: Tensor

    @classmethod
    def of(
        cls, material: NeoHookean, volumes: Tensor, gradients: Sequence[Tensor]
    ) -> EnergyOfTerms:
        """Return Π of terms.

        Parameters
        ----------
        material : NeoHookean
        volumes : Tensor, (n_points,)
            Of the quadrature points in m³ (m² in the plane).
        gradients : sequence of n tensors, (…, d, d, n_points)
            Hₖ.
        """
        mu, growth, decay = Factors.of(material)
        h = torch.stack(list(gradients), -4)  # (…, n, d, d, n_points)
        jacobian = JacobianPolynomial.of(h)
        flat, n = h.flatten(-3), len(gradients)
        squares = mu * ((h * volumes).flatten(-3) @ flat.mT).double()
        integrals = mu * (jacobian.coefficients @ volumes).double()
        nonlinear = torch.cat((0 * integrals[..., :n], integrals[..., n:]), -1)
        traces = jacobian.coefficients[..., :n, :]
        squared = (traces @ (traces[..., 0, :] * volumes)[..., None])[..., 0].double()
        mixed = nonlinear[..., n : 2 * n]  # of c₁ cₖ
        products = torch.cat((2 * mixed[..., :1], mixed[..., 1:]), -1)
        works = squares[..., 0, :] - products + (material.lame_lambda + mu) * squared
        return cls(jacobian, growth * volumes, decay * volumes, squares, nonlinear, works)

    @property
    def rounding(self) -> float:
        """Relative rounding of a number in the precision of the gradients."""
        return torch.finfo(self.square.dtype).eps

    def at(self, c: Tensor) -> State:
        """Evaluate Π; it is +∞ where J is not positive at a point, without derivatives there."""
        values, slopes, curvatures = self.jacobian.monomials(c)
        coefficients = self.jacobian.coefficients
        e = _sum(values.to(coefficients), coefficients)
        inside = e > SMALLEST_J - 1
        inside_everywhere = inside.all(-1)
        if not _is_known(inside_everywhere.all()):
            e = torch.where(inside, e, SMALLEST_J - 1)
        inverse = 1 / (1 + e)
        logarithmic = inverse * self.excess
        integrals = (coefficients @ ((logarithmic + self.square) * e)[..., None])[..., 0].double()
        first = slopes.to(coefficients) @ coefficients
        weighted = first * (logarithmic * inverse + self.square)[..., None, :]
        forces = integrals - self.nonlinear
        hessian = self._hessian(forces, curvatures) + (weighted @ first.mT).double()
        e = e.double()
        energy = (e - torch.log1p(e)) @ self.excess.double()
        energy = energy + 0.5 * _dot(self.square.double() * e, e) - _dot(values, self.nonlinear)
        stretched = _sum(c, self.squares) - self.works
        energy = energy + 0.5 * _dot(c, stretched - self.works)
        gradient = stretched + (slopes @ forces[..., None])[..., 0]
        if not _is_known(inside_everywhere.all()):
            energy = torch.where(inside_everywhere, energy, inf)
        return State(c, energy, gradient, hessian)

    def some(self, rows: Tensor) -> EnergyOfTerms:
        """Return Π of some loads of the batch."""
        parts = (each[rows] for each in (self.squares, self.nonlinear, self.works))
        return EnergyOfTerms(self.jacobian.some(rows), self.square, self.excess, *parts)

    def _hessian(self, forces: Tensor, curvatures: Tensor) -> Tensor:
        """Hessian of what is linear in J or quadratic in c, of ∂Π/∂pₘ: (…, n, n)."""
        return self.squares + _sum(forces, curvatures).reshape(self.squares.shape)


class Newton:
    """Newton's method for the least Π of a batch of N loads.

    Parameters
    ----------
    potential : EnergyOfTerms
    """

    def __init__(self, potential: EnergyOfTerms) -> None:
        self.potential, rounding = potential, potential.rounding
        self.stiffness = potential.squares.diagonal(dim1=-2, dim2=-1)
        invisible = rounding**2 * self.stiffness[..., :1] + TINY  # beside the first term
        self.scale = (self.stiffness + invisible) ** -0.5  # unit stiffness of every term
        self.smallest, self.rounding = max(SMALLEST_STEP, rounding), ROUNDING * rounding

    def start(self) -> Search:
        """Return the step from terms that fade."""
        state = self.potential.at(_fading(self.stiffness))
        shift = torch.full_like(state.energy, SMALLEST_SHIFT)
        none = torch.zeros((), dtype=torch.int64, device=shift.device)
        return self._with_step(state, shift, none)

    def advance(self, *search: Tensor) -> Search:
        """Take a step, and return the next one."""
        c, energy, gradient, hessian, shift, after, _, evaluations = search
        halves = 0.5 ** torch.cumsum(torch.ones_like(c), -1)  # c_k of half the load
        trial = self.potential.at(torch.where((energy == inf)[..., None], c * halves, after))
        falls = trial.energy <= energy + self.rounding * abs(energy)  # ∞ ≤ ∞
        state = _where(falls, trial, State(c, energy, gradient, hessian))
        larger = torch.clamp(GROWTH * shift, min=SECOND_SHIFT)
        return self._with_step(state, torch.where(falls, SMALLEST_SHIFT, larger), evaluations)

    def _with_step(self, state: State, shift: Tensor, evaluations: Tensor) -> Search:
        c, energy, gradient, hessian = state
        scale, unit = self.scale, torch.eye(c.shape[-1], dtype=c.dtype, device=c.device)
        scales = scale[..., :, None] * scale[..., None, :]
        relative = solved(hessian * scales + shift[..., None, None] * unit, gradient * scale)
        small = SMALL_STEP * abs(c[..., -1] / scale[..., -1]) + self.smallest / scale[..., 0]
        is_last = (_dot(relative, relative) <= small * small) & (shift <= SMALLEST_SHIFT)
        is_last = is_last & (energy < inf)  # the next step is of the order of the square
        return Search(*state, shift, c - scale * relative, is_last, evaluations + 1)


class LeastEnergy:
    """The search for the least Π of batches of loads on one body.

    A step of the search has a hundred operations on small tensors. On a GPU they are one CUDA
    graph, for batches whose sizes are powers of two; some loads then fill several rows.
    """

    def __init__(self) -> None:
        self._advanced = Replayed(_advanced, most=GRAPHS)

    def __call__(
        self, material: NeoHookean, volumes: Tensor, gradients: Sequence[Tensor]
    ) -> Tensor:
        """Return the coefficients c of the least Π, in double precision: (N, n).

        Loads leave the batch after their last step. In an exported file, all go on until the last
        one has taken its own.

        Parameters
        ----------
        material : NeoHookean
        volumes : Tensor, (n_points,)
            In m³ (m² in the plane).
        gradients : sequence of n tensors, (N, d, d, n_points)
            Hₖ at the points.
        """
        potential = EnergyOfTerms.of(material, volumes, gradients)
        newton = Newton(potential)
        search = newton.start()
        if torch.compiler.is_compiling():  # an exported file
            in_file: Callable[..., tuple[Tensor, ...]] = while_loop
            search = Search(*in_file(_goes_on, newton.advance, tuple(search)))
            return torch.where(search.is_last.all(), search.after, search.c)
        found, on_gpu = search.c.clone(), search.c.device.type == "cuda"
        rows, left = torch.arange(len(found), device=found.device), torch.ones_like(search.is_last)
        for _ in range(EVALUATIONS):
            last = torch.nonzero(left & search.is_last)[:, 0]
            found[rows[last]] = search.after[last]
            left = left & ~search.is_last
            places = torch.nonzero(left)[:, 0]
            if len(places) == 0:
                return found
            size = power_of_two(len(places)) if on_gpu else len(places)
            if size != len(rows):
                left = torch.arange(size, device=rows.device) < len(places)
                places = torch.cat((places, places[:1].expand(size - len(places))))
                rows, search, potential = rows[places], search.some(places), potential.some(places)
            search = Search(*self._advanced(*search, *potential.jacobian, *potential[1:]))
        found[rows[left]] = torch.where(search.is_last[:, None], search.after, search.c)[left]
        return found


def power_of_two(count: int) -> int:
    """Return the least power of two that is no less than a count."""
    return 1 << max(count - 1, 0).bit_length()


def _advanced(*given: Tensor) -> Search:
    """Take a step; a function of tensors alone."""
    count = len(Search._fields)
    search, (coefficients, forms, curvatures, *others) = given[:count], given[count:]
    jacobian = JacobianPolynomial(coefficients, forms, curvatures)
    return Newton(EnergyOfTerms(jacobian, *others)).advance(*search)


def _goes_on(*search: Tensor) -> Tensor:
    *_, is_last, evaluations = search
    return ~is_last.all() & (evaluations <= EVALUATIONS)


def solved(matrix: Tensor, right: Tensor) -> Tensor:
    """Solve small symmetric systems: (…, n, n), (…, n) → (…, n).

    Exported files have no operation that solves, so that tensors are eliminated row by row.
    """
    rows = []
    while right.shape[-1] > 1:
        pivot, row, value = matrix[..., 0, :1], matrix[..., 0, 1:], right[..., :1]
        rows.append((pivot, row, value))
        factor = matrix[..., 1:, 0] / pivot
        matrix = matrix[..., 1:, 1:] - factor[..., :, None] * row[..., None, :]
        right = right[..., 1:] - factor * value
    found = right / matrix[..., 0]
    for pivot, row, value in reversed(rows):
        found = torch.cat([(value - _dot(row, found)[..., None]) / pivot, found], -1)
    return found


def _fading(squares: Tensor) -> Tensor:
    r"""Coefficients :math:`\prod_{j=2}^k 1 / (1 + (M_{jj} / M_{j-1,j-1})^2)`: (…, n) → same.

    They are 1 - O(t⁴) under loads t f, and small after a term that is larger than that before it.
    """
    ratios = squares[..., 1:] / (squares[..., :-1] + TINY)
    falls = 1 / (1 + ratios * ratios)
    factors = [0 * squares[..., 0] + 1]
    for k in range(falls.shape[-1]):
        factors.append(factors[-1] * falls[..., k])
    return torch.stack(factors, -1)


def _dot(a: Tensor, b: Tensor) -> Tensor:
    """Products of vectors: (…, n), (…, n) → (…)."""
    return (a * b).sum(-1)


def _sum(c: Tensor, x: Tensor) -> Tensor:
    """Σₖ cₖ xₖ: (…, n), (…, n, m) → (…, m)."""
    return (c[..., None, :] @ x)[..., 0, :]


def _where(condition: Tensor, some: State, others: State) -> State:
    """Choose states, sample by sample."""
    if _is_known(condition.all()):
        return some
    axes = condition.ndim
    return State(
        *(
            torch.where(condition[(..., *(None,) * (a.ndim - axes))], a, b)
            for a, b in zip(some, others, strict=True)
        )
    )


def _is_known(condition: Tensor) -> bool:
    """Whether a condition holds; exported files know none, and a GPU would have to be waited for.

    All is then done as if it did not.
    """
    is_known = not torch.compiler.is_compiling() and condition.device.type != "cuda"
    return is_known and bool(condition)
