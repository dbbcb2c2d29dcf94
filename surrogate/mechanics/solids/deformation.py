r"""Stress and moduli of a material at given deformation gradients, from the derivatives of its law.

The measures of F (`surrogate.mechanics.energy.law`) have the derivatives

.. math::
    \frac{∂I_1}{∂F} = 2 F, \quad \frac{∂I_2}{∂F} = 2 \, \mathrm{cof} F × F, \quad
    \frac{∂J}{∂F} = \mathrm{cof} F, \quad \frac{∂I_4}{∂F} = 2 F a ⊗ a, \quad
    \frac{∂K_4}{∂F} = 2 F × (\mathrm{cof} F \, a ⊗ a)

with the cross product of tensors (J. Bonet, A. J. Gil and R. Ortigosa, *A computational framework
for polyconvex large strain elasticity*, CMAME 283, 2015), :math:`F × F = 2 \, \mathrm{cof} F`. With
:math:`ψ_a` for derivatives of the energy by measures :math:`m_a`,

.. math::
    P = \sum_a ψ_a \frac{∂m_a}{∂F}, \qquad
    \frac{∂P}{∂F} : H = \sum_{ab} ψ_{ab} \left(\frac{∂m_b}{∂F} : H\right) \frac{∂m_a}{∂F}
    + \sum_a ψ_a \frac{∂^2 m_a}{∂F^2} : H.

Tensors have their components first: F is (d, d, …), scalars are (…). In the plane, where
:math:`F_{33} = 1`, :math:`F × H` stands for the derivative of the cofactors, :math:`(\mathrm{tr} H)
I - H^T`, and there is no I₂. Where J ≤ 0, or a material has no energy, the energy is +∞.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from shared_schema.common.bodies.polar_decomposition import cofactors as any_cofactors
from shared_schema.common.bodies.polar_decomposition import library_of
from shared_schema.materials import Material
from surrogate.mechanics.energy.law import DILATION, FIBRES, FIRST, SECOND, VOLUME, Law, law_of
from surrogate.mechanics.energy.law import is_zero as is_none

Values = Any  # a Tensor or an array, or a number


class Deformation:
    """A deformation gradient, its cofactors and its measures.

    Parameters
    ----------
    f : Tensor, (d, d, …)
    dilation : Tensor, (…), optional
        θ of the element.
    fibres : Tensor, (families, d, …), optional
        Unit directions; zero where there is none.

    Attributes
    ----------
    j : Tensor, (…)
        As it is, also where it is not positive.
    measures : list of Tensor
        Of `surrogate.mechanics.energy.law`, of some value where J is not positive.
    """

    def __init__(
        self, f: Tensor, dilation: Tensor | None = None, fibres: Tensor | None = None
    ) -> None:
        library = library_of(f)
        self.f, self.cofactor = f, cofactors(f)
        self.j = (f[0] * self.cofactor[0]).sum(0)
        self.inside = (self.j > 0) & (self.j < math.inf)
        positive = library.where(self.inside, self.j, 1.0)
        first = (f * f).sum((0, 1)) + (3 - len(f))
        second = (self.cofactor * self.cofactor).sum((0, 1)) if len(f) == 3 else first
        self.measures = [first, second, positive, positive]
        if dilation is not None:
            known = (dilation > 0) & (dilation < math.inf)
            self.inside = self.inside & known
            self.measures[DILATION] = library.where(known, dilation, 1.0)
        self._fibres = [] if fibres is None else list(fibres)
        self._stretched = [_times(f, a) for a in self._fibres]
        self._areas = [_times(self.cofactor, a) for a in self._fibres]
        for stretched, area in zip(self._stretched, self._areas, strict=True):
            self.measures += [(stretched * stretched).sum(0), (area * area).sum(0)]

    def energy(self, law: Law) -> Tensor:
        """W in J/m³, +∞ where it has no value: (…)."""
        w = law.energy(self.measures, torch)[0]
        return torch.where(self.inside & torch.isfinite(w), w, torch.inf)

    def stress(self, first: Sequence[Values]) -> Tensor:
        """P of the derivatives ψ_a: (d, d, …)."""
        total: Tensor | None = None
        for number, factor in enumerate(first):
            if number != DILATION and not is_none(factor):
                total = plus(total, factor, self.derivative(number))
        return 0 * self.f if total is None else total

    def derivative(self, number: int) -> Tensor:
        """∂m/∂F of a measure: (d, d, …)."""
        if number == FIRST:
            return 2 * self.f
        if number == SECOND:
            return 2 * cross(self.cofactor, self.f)
        if number == VOLUME:
            return self.cofactor
        family, is_area = divmod(number - FIBRES, 2)
        a = self._fibres[family]
        if is_area:
            return 2 * cross(self.f, _dyad(self._areas[family], a))
        return 2 * _dyad(self._stretched[family], a)

    def changes(self, h: Tensor, numbers: Sequence[int]) -> dict[int, Tensor]:
        """∂m/∂F : H of some measures: (d, d, …) → (…) each."""
        return {n: (self.derivative(n) * h).sum((0, 1)) for n in numbers if n != DILATION}

    def turned(self, h: Tensor, first: Sequence[Values]) -> Tensor:
        """Σ ψ_a ∂²m_a/∂F² : H of the derivatives ψ_a: (d, d, …) → same."""
        total: Tensor | None = None
        for number, factor in enumerate(first):
            if number == DILATION or is_none(factor):
                continue
            if number == FIRST:
                total = plus(total, 2 * factor, h)
                continue
            if number == SECOND:
                part = 2 * (cross(cross(self.f, h), self.f) + cross(self.cofactor, h))
            elif number == VOLUME and len(h) == 3:  # J [(F⁻ᵀ : H) F⁻ᵀ − F⁻ᵀ Hᵀ F⁻ᵀ]
                cof = self.cofactor
                part = (cof * h).sum((0, 1)) * cof - product(product(cof, h.swapaxes(0, 1)), cof)
                factor = factor / self.measures[VOLUME]
            elif number == VOLUME:
                part = cross(self.f, h)
            else:
                family, is_area = divmod(number - FIBRES, 2)
                a = self._fibres[family]
                if is_area:
                    change = _times(cross(self.f, h), a)
                    part = 2 * cross(self.f, _dyad(change, a))
                    if len(h) == 3:  # in the plane cofactors are linear
                        part = part + 2 * cross(h, _dyad(self._areas[family], a))
                else:
                    part = 2 * _dyad(_times(h, a), a)
            total = plus(total, factor, part)
        return 0 * (h + self.f) if total is None else total


def moduli_of(state: Deformation, law: Law, outputs: Sequence[Values]) -> Tensor:
    """∂P/∂F at fixed θ, of the outputs of `law.energy`: (d, d, d, d, …) in Pa."""
    d, points = len(state.f), state.f.shape[2:]
    second = {k: v for k, v in law.second(outputs).items() if DILATION not in k}
    unit = torch.eye(d * d, dtype=state.f.dtype, device=state.f.device)
    columns = []
    for row in unit.reshape(d * d, d, d, *(1 for _ in points)):
        columns.append(state.turned(row, outputs[1 : 1 + law.count]))
    k = torch.stack(columns, 2).reshape(d, d, d, d, *points)
    derivatives = {n: state.derivative(n) for pair in second for n in pair}
    for (a, b), factor in second.items():
        p, q = derivatives[a], derivatives[b]
        k = k + factor * p[:, :, None, None] * q
        if a != b:
            k = k + factor * q[:, :, None, None] * p
    return k


def energy_density(f: Tensor, material: Material) -> Tensor:
    """W(F) in J/m³, +∞ where J ≤ 0 or W has no value: (d, d, …) → (…)."""
    return Deformation(f).energy(law_of(material, len(f)))


def stress(f: Tensor, material: Material) -> Tensor:
    """First Piola–Kirchhoff stress P in Pa: (d, d, …) → (d, d, …)."""
    state, law = Deformation(f), law_of(material, len(f))
    return state.stress(law.stress(state.measures, torch))


def moduli(f: Tensor, material: Material) -> Tensor:
    """∂P/∂F in Pa: (d, d, …) → (d, d, d, d, …)."""
    state, law = Deformation(f), law_of(material, len(f))
    return moduli_of(state, law, law.energy(state.measures, torch))


def completed(f: Tensor) -> Tensor:
    """F in three dimensions: plane strain is completed by F₃₃ = 1, (d, d, …) → (3, 3, …)."""
    if len(f) == 3:
        return f
    full = f.new_zeros((3, 3, *f.shape[2:]))
    full[:2, :2], full[2, 2] = f, 1.0
    return full


def determinant(f: Tensor) -> Tensor:
    """J = det F: (d, d, …) → (…)."""
    if len(f) == 2:
        return f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
    return (f[0] * torch.linalg.cross(f[1], f[2], dim=0)).sum(0)


def cofactors(f: Tensor) -> Tensor:
    """∂J/∂F: (d, d, …) → same."""
    if library_of(f) is np:
        return _cofactors_of(f)
    return cross(f, f) / 2 if len(f) == 3 else cross(f, f)


def cross(a: Tensor, b: Tensor) -> Tensor:
    """A × B, in the plane (tr B) I - Bᵀ: (d, d, …) twice → same."""
    if len(b) == 2:
        found: Tensor = _cofactors_of(b)
        return found if found.shape == a.shape else found + 0 * a
    if library_of(a) is np:
        return _cross_of_arrays(a, b)
    rows = []
    for i in range(3):
        k, n = (i + 1) % 3, (i + 2) % 3
        rows.append(torch.linalg.cross(a[k], b[n], dim=0) + torch.linalg.cross(b[k], a[n], dim=0))
    return torch.stack(rows)


def _cofactors_of(f: Values) -> Any:
    """Those of tensors or arrays."""
    return any_cofactors(f)


def _cross_of_arrays(a: Values, b: Values) -> Values:
    """A × B in space, by components: `numpy.cross` copies its arguments."""
    found = np.empty(np.broadcast_shapes(a.shape, b.shape), a.dtype)
    following = (1, 2, 0, 1)
    for i in range(3):
        k, n = following[i], following[i + 1]
        for j in range(3):
            m, r = following[j], following[j + 1]
            found[i, j] = a[k, m] * b[n, r] - a[k, r] * b[n, m]
            found[i, j] += a[n, r] * b[k, m] - a[n, m] * b[k, r]
    return found


def plus(total: Tensor | None, factor: Values, field: Tensor) -> Tensor:
    """A sum and x A, in one pass over the fields: (d, d, …)."""
    if total is None:
        return factor * field
    if isinstance(factor, Tensor):
        return torch.addcmul(total, factor, field)
    return total + factor * field


def product(a: Values, b: Values) -> Values:
    """Matrix products A B: (d, d, …) twice → same."""
    total = a[:, :1] * b[0]
    for k in range(1, len(a)):
        total = total + a[:, k : k + 1] * b[k]
    return total


def _times(f: Tensor, a: Tensor) -> Tensor:
    """F a: (d, d, …), (d, …) → (d, …)."""
    return (f * a).sum(1)


def _dyad(a: Tensor, b: Tensor) -> Tensor:
    """A ⊗ b: (d, …) twice → (d, d, …)."""
    return a[:, None] * b
