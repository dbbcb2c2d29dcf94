r"""The combination of the terms of a series that is nearest to equilibrium.

.. math::
    u = \sum_{k=1}^n c_k u_k, \qquad g_k(c) = u_k · r(u) = \sum_q w_q P_q : H_{k,q}
    - (f + f_p(u)) · u_k = 0, \qquad \frac{∂g_k}{∂c_l} = \sum_q w_q δP_q(H_l) : H_{k,q} - …

with the dead forces f, the forces :math:`f_p` of loads that follow the body, and the changes δP of
the stress (`surrogate.mechanics.solids.stress_path`). All cₖ = 1 give the sum of the series,
which converges slowly under large loads, if at all. What the terms span is much better than their
sum: it is the reduced basis of A. K. Noor and J. M. Peters (*Reduced basis technique for nonlinear
analysis of structures*, AIAA Journal 18, 1980). Since :math:`K u_1 = f + f_p(0)`, the works of
these forces are the first column of the derivative at rest.

Under dead loads the combination is that of least potential energy Π. Newton's method finds it,
from terms that fade where they do not decrease, under half of the load as long as Π is infinite
there. A step that raises Π is not taken; the next one is tried with a larger shift of the
derivative (Levenberg, Marquardt). Under others no Π is used, and a step is taken if the
simplified step from its end is no longer (Deuflhard 2004, Section 3.3). This is for batches of
loads, in double precision, on any device and in exported files;
`surrogate.mechanics.series.compiled_weights` does the same for one.

The derivatives of c with respect to the terms are those of the last step, from a c that is found:
:math:`δc = -(∂g/∂c)^{-1} δg`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from math import inf
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch._higher_order_ops.while_loop import while_loop_op  # not public yet
from torch.func import functional_call

from surrogate.mechanics.series.following_terms import Works
from surrogate.mechanics.solids.solid import Solid
from surrogate.mechanics.solids.stress_path import StressPath
from surrogate.runtime.cuda_graphs import Replayed

EVALUATIONS = 30  # of g, at most
SMALLEST_SHIFT, SECOND_SHIFT, GROWTH = 1e-9, 1e-3, 10.0  # relative to the stiffness of every term
GRAPHS = 16  # that are kept, of batches on a GPU
ROUNDING, LEAST = 2.0**-40, 2.0**-52  # of Π, relative, and to the shear moduli times volumes
SMALL_STEP, SMALLEST_STEP = 3e-3, 1e-10  # relative to the last term, and to the first one
TINY = 1e-300  # no division by zero


class Search(NamedTuple):
    """Where the search is: a state, and the step to the next one.

    Attributes
    ----------
    c : Tensor, (N, n)
    energy : Tensor, (N,)
        Π in J, without its meaning under following loads; +∞ where a cell is inverted.
    gradient, hessian : Tensor, (N, n), (N, n, n)
        g and its derivative.
    shift : Tensor, (N,)
        Of the derivative.
    after : Tensor, (N, n)
        Coefficients after the step.
    is_last : Tensor, (N,)
        Whether no step is needed after it.
    evaluations : Tensor, ()
        Their number.
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


class Terms(NamedTuple):
    """What g(c) is made of.

    Attributes
    ----------
    h : Tensor, (d, d, n, n_cells, N, n_points)
        Hₖ = ∇uₖ.
    stiffness : Tensor, (N, n)
        Σ w μ Hₖ : Hₖ in J, with the shear moduli at rest.
    works : Tensor, (N, n)
        (f + f_p(0)) · uₖ in J.
    pressed, legs, tensions : Tensor or None
        Of `surrogate.mechanics.series.following_terms.Works`.
    """

    h: Tensor
    stiffness: Tensor
    works: Tensor
    pressed: Tensor | None = None
    legs: Tensor | None = None
    tensions: Tensor | None = None

    @property
    def following(self) -> Works | None:
        """Works of following loads; None under dead ones."""
        return None if self.pressed is None else Works(self.pressed, self.legs, self.tensions)

    def some(self, rows: Tensor) -> Terms:
        """Return those of some loads of the batch."""
        rest = (None if each is None else each[rows] for each in self[1:])
        return Terms(self.h[..., rows, :], *rest)  # type: ignore[arg-type]


class Weights:
    """The search for the weights of batches of loads on one body.

    A step of the search has hundreds of operations on small tensors. On a GPU they are one CUDA
    graph, for batches whose sizes are powers of two; some loads then fill several rows.

    Parameters
    ----------
    solid : Solid
    """

    def __init__(self, solid: Solid) -> None:
        self.solid = solid
        assert solid.laws  # which exporters cannot trace
        self._moduli = solid.moduli_of_cells()[:, None, None]
        self._stiffness = float((self._moduli[:, 0] * solid.volumes.cpu()).sum())

    def __call__(self, h: Tensor, following: Works | None = None) -> Tensor:
        """Return the coefficients c, (N, n), of what `Terms` holds.

        Loads leave the batch after their last step. In an exported file, all go on until the last
        one has taken its own.
        """
        terms = self.terms(h, following)
        if torch.compiler.is_compiling():  # an exported file
            return self._in_file(terms)
        with torch.no_grad():
            c = self._found(terms)
        if not (torch.is_grad_enabled() and h.requires_grad):
            return c
        with torch.no_grad():
            _, _, hessian = self.at(c, terms)
        _, gradient, _ = self.at(c, terms, curved=False)
        scale = self._scale(terms).detach()
        return c - scale * solved(_scaled(hessian, scale, SMALLEST_SHIFT), gradient * scale)

    def terms(self, h: Tensor, following: Works | None = None) -> Terms:
        """Find the works of the forces, and the stiffness of the terms."""
        volumes = self.solid.volumes[:, None]
        change = volumes * StressPath(self.solid).along(h[:, :, :1])
        weights = self._moduli.to(volumes) * volumes
        works = (change * h).sum((0, 1, 3, 5)).T
        return Terms(h, (weights * h * h).sum((0, 1, 3, 5)).T, works, *(following or ()))

    def at(self, c: Tensor, terms: Terms, curved: bool = True) -> tuple[Tensor, Tensor, Tensor]:
        """Return Π, g and its derivative: (N,), (N, n), (N, n, n); the last one if `curved`."""
        solid, h, volumes = self.solid, terms.h, self.solid.volumes[:, None]
        path = StressPath(solid, solid.identity[:, :, None] + combined(c, h))
        density = volumes * path.energy
        inside = (path.inside & torch.isfinite(density)).all(3).all(1)[0]
        energy = torch.where(inside, density.sum((0, 1, 3)) - (c * terms.works).sum(1), inf)
        rows = torch.cat([path.stress, path.along(h)], 2) if curved else path.stress
        both = torch.einsum("ijlcnq,ijkcnq->nkl", volumes * rows, h)
        gradient, hessian = both[..., 0] - terms.works, both[..., 1:]
        if (following := terms.following) is not None:
            works, slopes = following.at(c)
            gradient = gradient + following.at_rest - works
            hessian = hessian - slopes if curved else hessian
        return energy, gradient, hessian.contiguous()  # as loops in files ask for

    def _in_file(self, terms: Terms) -> Tensor:
        step = _Step(self)
        names, buffers = zip(*step.named_buffers(), strict=True)
        given = (*(each for each in terms if each is not None), *buffers)
        start, count = tuple(self._start(terms)), len(given) - len(names)

        def advance(*of: Tensor) -> tuple[Tensor, ...]:
            size = len(start) + count
            return functional_call(step, dict(zip(names, of[size:], strict=True)), of[:size])

        loop: Callable[..., tuple[Tensor, ...]] = while_loop_op
        search = Search(*loop(_goes_on, advance, start, given))
        return torch.where(search.is_last.all(), search.after, search.c)

    def _found(self, terms: Terms) -> Tensor:
        search = self._start(terms)
        found, on_gpu = search.c.clone(), search.c.device.type == "cuda"
        rows, left = torch.arange(len(found), device=found.device), torch.ones_like(search.is_last)
        for _ in range(EVALUATIONS + 1):
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
                rows, search, terms = rows[places], search.some(places), terms.some(places)
            given = (each for each in (*search, *terms) if each is not None)
            search = Search(*(self._replayed if on_gpu else self._advanced)(*given))
        found[rows[left]] = torch.where(search.is_last[:, None], search.after, search.c)[left]
        return found

    @cached_property
    def _replayed(self) -> Replayed:
        return Replayed(self._advanced, most=GRAPHS)

    def _advanced(self, *given: Tensor) -> tuple[Tensor, ...]:
        """Take a step; a function of tensors alone."""
        count = len(Search._fields)
        return tuple(self._next(Search(*given[:count]), Terms(*given[count:])))

    def _start(self, terms: Terms) -> Search:
        """Begin before terms that fade, as if these were of half the load, and that infinite."""
        c = _fading(terms.stiffness) * 2.0 ** torch.cumsum(torch.ones_like(terms.works), -1)
        zero, hessian = torch.zeros_like(c), torch.diag_embed(torch.ones_like(c))
        energy = torch.full_like(c[:, 0], inf)
        shift = torch.full_like(energy, SMALLEST_SHIFT)
        none = torch.zeros((), dtype=torch.int64, device=c.device)
        return Search(c, energy, zero, hessian, shift, c.clone(), energy < 0, none)

    def _next(self, search: Search, terms: Terms) -> Search:
        """Take a step, and return the next one."""
        c, energy, gradient, hessian, shift, after, _, evaluations = search
        halves = 0.5 ** torch.cumsum(torch.ones_like(c), -1)  # c_k of half the load
        trial = torch.where((energy == inf)[:, None], c * halves, after)
        new_energy, new_gradient, new_hessian = self.at(trial, terms)
        if terms.following is None:
            rounding = ROUNDING * abs(energy) + LEAST * self._stiffness
            taken = new_energy <= energy + rounding  # ∞ ≤ ∞
        else:
            scale = self._scale(terms)
            back = solved(_scaled(hessian, scale, shift), new_gradient * scale)
            size, length = _dot(back, back), _dot((after - c) / scale, (after - c) / scale)
            small = self._small(c, scale)
            taken = (new_energy < inf) & (size <= length + small * small) | (energy == inf)
        wide, square = taken[:, None], taken[:, None, None]
        larger = torch.clamp(GROWTH * shift, min=SECOND_SHIFT)
        return self._with_step(
            torch.where(wide, trial, c),
            torch.where(taken, new_energy, energy),
            torch.where(wide, new_gradient, gradient),
            torch.where(square, new_hessian, hessian),
            torch.where(taken, SMALLEST_SHIFT, larger),
            evaluations,
            terms,
        )

    def _with_step(
        self,
        c: Tensor,
        energy: Tensor,
        gradient: Tensor,
        hessian: Tensor,
        shift: Tensor,
        evaluations: Tensor,
        terms: Terms,
    ) -> Search:
        scale = self._scale(terms)
        step = solved(_scaled(hessian, scale, shift), gradient * scale)
        small = self._small(c, scale)
        is_last = (_dot(step, step) <= small * small) & (shift <= SMALLEST_SHIFT)
        is_last = is_last & (energy < inf)  # the next step is of the order of the square
        after = c - scale * step
        return Search(c, energy, gradient, hessian, shift, after, is_last, evaluations + 1)

    def _scale(self, terms: Terms) -> Tensor:
        """Coefficients of terms of unit stiffness."""
        invisible = torch.finfo(terms.stiffness.dtype).eps ** 2 * terms.stiffness[:, :1] + TINY
        return (terms.stiffness + invisible) ** -0.5  # beside the first term

    def _small(self, c: Tensor, scale: Tensor) -> Tensor:
        """Length of a step that is the last one, in units of `_scale`."""
        return SMALL_STEP * abs(c[:, -1] / scale[:, -1]) + SMALLEST_STEP / scale[:, 0]


def combined(c: Tensor, fields: Tensor) -> Tensor:
    """Σₖ cₖ Hₖ: (N, n), (d, d, n, n_cells, N, n_points) → (d, d, 1, n_cells, N, n_points)."""
    total = c[:, :1] * fields[:, :, :1]
    for k in range(1, c.shape[1]):
        total = torch.addcmul(total, c[:, k : k + 1], fields[:, :, k : k + 1])
    return total


def power_of_two(count: int) -> int:
    """Return the least power of two that is no less than a count."""
    return 1 << max(count - 1, 0).bit_length()


class _Step(nn.Module):
    """A step of the search, of what it carries, the terms, and buffers of the solid."""

    def __init__(self, weights: Weights) -> None:
        super().__init__()
        self.solid, self._advanced = weights.solid, weights._advanced

    def forward(self, *given: Tensor) -> tuple[Tensor, ...]:
        """Return what it carries on."""
        return self._advanced(*given)


def _goes_on(*given: Tensor) -> Tensor:
    *_, is_last, evaluations = given[: len(Search._fields)]
    return ~is_last.all() & (evaluations <= EVALUATIONS)


def _scaled(matrix: Tensor, scale: Tensor, shift: Tensor | float) -> Tensor:
    """A matrix in units of `scale`, shifted: (N, n, n)."""
    unit = torch.eye(scale.shape[-1], dtype=scale.dtype, device=scale.device)
    more = shift[:, None, None] * unit if isinstance(shift, Tensor) else shift * unit
    return matrix * scale[:, :, None] * scale[:, None] + more


def solved(matrix: Tensor, right: Tensor) -> Tensor:
    """Solve small systems: (…, n, n), (…, n) → (…, n).

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
