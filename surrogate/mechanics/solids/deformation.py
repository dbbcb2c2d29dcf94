r"""Stress of a material at given deformation gradients, from the derivatives of its law.

The measures of F (`surrogate.mechanics.energy.law`) have the derivatives

.. math::
    \frac{∂I_1}{∂F} = 2 F, \quad \frac{∂I_2}{∂F} = 2 \, \mathrm{cof} F × F, \quad
    \frac{∂J}{∂F} = \mathrm{cof} F, \quad \frac{∂I_4}{∂F} = 2 F a ⊗ a, \quad
    \frac{∂K_4}{∂F} = 2 F × (\mathrm{cof} F \, a ⊗ a)

with the cross product of tensors (J. Bonet, A. J. Gil and R. Ortigosa, *A computational framework
for polyconvex large strain elasticity*, CMAME 283, 2015), :math:`F × F = 2 \, \mathrm{cof} F`. With
:math:`ψ_a` for derivatives of the energy by measures :math:`m_a`,

.. math:: P = \sum_a ψ_a \frac{∂m_a}{∂F}.

Tensors have their components first: F is (d, d, …), scalars are (…). In the plane, where
:math:`F_{33} = 1`, cofactors are :math:`(\mathrm{tr} F) I - F^T`, and there is no I₂. Where J ≤ 0,
or a material has no energy, the energy is +∞.

All of it is sums of products, of tensors, of series of such
(`surrogate.mechanics.energy.power_series`), or of numbers that are recorded
(`surrogate.mechanics.energy.recording`).

The law of a material is recorded as a whole by `recorded_law`, of F, directions of fibres and, of
some elements, θ and p. What runs the recording, with numbers, derivatives or power series, computes
the stress of any material.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from shared_schema.common.bodies.polar_decomposition import cofactors as cofactors_of_arrays
from shared_schema.common.bodies.polar_decomposition import library_of
from shared_schema.materials import Material
from surrogate.mechanics.energy.law import DILATION, FIBRES, FIRST, SECOND, VOLUME, Law, law_of
from surrogate.mechanics.energy.power_series import Series, Spherical, product, unit_tensor
from surrogate.mechanics.energy.recording import Recording, is_zero
from surrogate.mechanics.energy.tape import sum_of_products

Values = Any  # a tensor, an array of recorded numbers, or a series; or a number


class Deformation:
    """A deformation gradient, its cofactors and its measures.

    Parameters
    ----------
    f : Values, (d, d, …)
    dilation : Values, (…), optional
        θ of the element.
    fibres : Values, (families, d, …), optional
        Unit directions; zero where there is none.

    Attributes
    ----------
    j : Values, (…)
        As it is, also where it is not positive.
    measures : list of Values
        Of `surrogate.mechanics.energy.law`, of some value where J is not positive.
    """

    def __init__(self, f: Values, dilation: Values = None, fibres: Values = None) -> None:
        self.f, self.cofactor, self._dilation = f, cofactors(f), dilation
        self.j = product(_of_first_rows, f, self.cofactor)
        first, second = contraction(f, f) + (3 - len(f)), 0.0
        if len(f) == 3:
            second = contraction(self.cofactor, self.cofactor)
        self.measures = [first, second, _guarded(self.j), _guarded(self.j)]
        if dilation is not None:
            self.measures[DILATION] = _guarded(dilation)
        self._fibres = [] if fibres is None else list(fibres)
        self._stretched = [product(_along, f, a) for a in self._fibres]
        self._areas = [product(_along, self.cofactor, a) for a in self._fibres]
        for pair in zip(self._stretched, self._areas, strict=True):
            self.measures += [product(_dot, each, each) for each in pair]

    @property
    def inside(self) -> Tensor:
        """Whether J and θ are positive and finite, those of order 0 of series: (…)."""
        given = [self.j] if self._dilation is None else [self.j, self._dilation]
        zeroth = [each.term(0) if isinstance(each, Series) else each for each in given]
        found: Tensor = _inside(zeroth[0])
        return found & _inside(zeroth[1]) if len(zeroth) > 1 else found

    def energy(self, law: Law) -> Tensor:
        """W in J/m³, +∞ where it has no value: (…)."""
        w = law.energy(self.measures)[0]
        return torch.where(self.inside & torch.isfinite(w), w, torch.inf)

    def stress(self, first: Sequence[Values]) -> Values:
        """P of the derivatives ψ_a: (d, d, …)."""
        numbers = [n for n, of in enumerate(first) if n != DILATION and not is_zero(of)]
        terms = [(first[number], *self._derivative(number)) for number in numbers]
        return sum_of_products(terms) if terms else 0 * self.f

    def _derivative(self, number: int) -> tuple[Values, float]:
        """∂m/∂F of a measure as a tensor, (d, d, …), and its factor."""
        if number == FIRST:
            return self.f, 2.0
        if number == SECOND:
            return cross(self.cofactor, self.f), 2.0
        if number == VOLUME:
            return self.cofactor, 1.0
        family, is_area = divmod(number - FIBRES, 2)
        a = self._fibres[family]
        if is_area:
            return cross(self.f, product(_dyad, self._areas[family], a)), 2.0
        return product(_dyad, self._stretched[family], a), 2.0


def energy_density(f: Tensor, material: Material) -> Tensor:
    """W(F) in J/m³, +∞ where J ≤ 0 or W has no value: (d, d, …) → (…)."""
    return Deformation(f).energy(law_of(material, len(f)))


def stress(f: Tensor, material: Material) -> Tensor:
    """First Piola–Kirchhoff stress P in Pa: (d, d, …) → (d, d, …)."""
    state, law = Deformation(f), law_of(material, len(f))
    found: Tensor = state.stress(law.stress(state.measures))
    return found


def completed(f: Tensor) -> Tensor:
    """F in three dimensions: plane strain is completed by F₃₃ = 1, (d, d, …) → (3, 3, …)."""
    if len(f) == 3:
        return f
    full = f.new_zeros((3, 3, *f.shape[2:]))
    full[:2, :2], full[2, 2] = f, 1.0
    return full


def determinant(f: Tensor) -> Tensor:
    """J = det F: (d, d, …) → (…)."""
    found: Tensor = _of_first_rows(f, cofactors(f))
    return found


def cofactors(f: Values) -> Values:
    """∂J/∂F: (d, d, …) → same."""
    if len(f) == 2:
        return cross(f, f)
    return cofactors_of_arrays(f) if library_of(f) is np else product(_cross, f, f, 0.5)


def cross(a: Values, b: Values) -> Values:
    """A × B, in the plane (tr B) I - Bᵀ: (d, d, …) twice → same."""
    if len(b) == 2:
        return b.mapped(_crossed_unit) if isinstance(b, Series) else _crossed_unit(b)
    return product(_cross, a, b)


def contraction(a: Values, b: Values) -> Values:
    """A : B, (d, d, …) twice → (…)."""
    return product(_contraction, a, b)


def _contraction(a: Values, b: Values) -> Values:
    if isinstance(a, Spherical):
        return a.factor * _trace(b)
    return b.factor * _trace(a) if isinstance(b, Spherical) else (a * b).sum((0, 1))


def _of_first_rows(a: Values, b: Values) -> Values:
    """Σⱼ A₁ⱼ B₁ⱼ: (d, d, …) twice → (…)."""
    if isinstance(a, Spherical):
        return a.factor * (b.factor if isinstance(b, Spherical) else b[0, 0])
    return b.factor * a[0, 0] if isinstance(b, Spherical) else (a[0] * b[0]).sum(0)


def _cross(a: Values, b: Values) -> Values:
    """A × B in space."""
    if isinstance(a, Spherical):
        return a.factor * _crossed_unit(b, a.unit)
    if isinstance(b, Spherical):
        return b.factor * _crossed_unit(a, b.unit)
    if library_of(a) is np:
        return _cross_of_arrays(a, b)
    rows = []
    for i in range(3):
        k, n = (i + 1) % 3, (i + 2) % 3
        rows.append(torch.linalg.cross(a[k], b[n], dim=0) + torch.linalg.cross(b[k], a[n], dim=0))
    return torch.stack(rows)


def _cross_of_arrays(a: Values, b: Values) -> Values:
    """A × B of recorded numbers, by components."""
    found = np.empty((3, 3), dtype=object)
    for i, j in np.ndindex(3, 3):
        k, n, m, r = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
        found[i, j] = a[k, m] * b[n, r] - a[k, r] * b[n, m] + a[n, r] * b[k, m] - a[n, m] * b[k, r]
    return found


def _crossed_unit(b: Values, unit: Tensor | None = None) -> Values:
    """I × B = (tr B) I - Bᵀ: (d, d, …) → same."""
    if isinstance(b, Spherical):
        return (len(b) - 1) * b
    unit = unit_tensor(b) if unit is None else unit
    if len(b) == 2:
        return (2 * unit - 1) * library_of(b).flip(b, (0, 1))
    return _trace(b) * unit - b.swapaxes(0, 1)


def _trace(a: Values) -> Values:
    """Tr A: (d, d, …) → (…)."""
    return len(a) * a.factor if isinstance(a, Spherical) else a.diagonal(0, 0, 1).sum(-1)


def _along(f: Values, a: Values) -> Values:
    """F a: (d, d, …), (d, …) → (d, …)."""
    return f.factor * a if isinstance(f, Spherical) else (f * a).sum(1)


def _dot(a: Values, b: Values) -> Values:
    """A · b: (d, …) twice → (…)."""
    return (a * b).sum(0)


def _dyad(a: Values, b: Values) -> Values:
    """A ⊗ b: (d, …) twice → (d, d, …)."""
    return a[:, None] * b


def _inside(j: Values) -> Values:
    return (j > 0) & (j < math.inf)


def _guarded(j: Values) -> Values:
    """The same, 1 where it is not positive and finite."""
    if isinstance(j, Series):
        return j.guarded(_inside)
    return torch.where(_inside(j), j, 1.0) if isinstance(j, Tensor) else j


def recorded_law(law: Law, d: int, projects: bool) -> tuple[Recording, dict[str, Any]]:
    """Record the derivatives of W(F, θ) + p (J - θ) by F and, where there are some, θ and p.

    Parameters
    ----------
    law : Law
    d : int
        Dimension.
    projects : bool
        Whether the element finds θ and p by itself.

    Returns
    -------
    recording : Recording
        Its inputs are F, (d, d), directions (families, d), and θ and p.
    outputs : dict
        ``derivatives``; ``stress``, those by F; ``volume``, J; ``energy``, W; ``slope``, ∂W/∂θ.
    """
    size = d * d + law.families * d
    recording = Recording(size + 2 * projects)
    f: Any = recording.inputs[: d * d].reshape(d, d)
    fibres: Any = recording.inputs[d * d : size].reshape(-1, d)
    dilation, pressure = recording.inputs[size:] if projects else (None, None)
    state: Any = Deformation(f, dilation, fibres)
    energy, *first = law.recording.replayed(state.measures, law.outputs)
    stress = state.stress(first)
    outputs = {
        "volume": state.j,
        "energy": energy,
        "stress": stress,
        "derivatives": stress.ravel(),
    }
    if projects:
        stress = stress + pressure * state.cofactor
        slope = first[DILATION]
        by = [*stress.ravel(), slope - pressure, state.j - dilation]
        outputs |= {"slope": slope, "stress": stress, "derivatives": np.array(by)}
    return recording, outputs
