r"""Changes of the stress with the deformation: the product with the tangent, of any elements.

.. math::
    δP = \frac{∂P}{∂F} : H + \frac{∂^2 W}{∂F ∂θ} δθ + δp \, \mathrm{cof} F, \qquad
    δθ = Π (\mathrm{cof} F : H), \quad
    δp = Π \left(\frac{∂^2 W}{∂θ ∂F} : H + \frac{∂^2 W}{∂θ^2} δθ\right)

with the moduli of `surrogate.mechanics.solids.deformation` and the projection Π of
`surrogate.mechanics.solids.solid`, where the elements have one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from surrogate.mechanics.energy.law import DILATION, Law
from surrogate.mechanics.solids.deformation import Deformation, cofactors
from surrogate.mechanics.solids.solid import Points, Solid, with_pressure_of


def stress_changes(solid: Solid, points: Points, h: Sequence[Tensor]) -> list[Tensor]:
    """δP of some H, (d, d, n_cells, N, n_points) each, at states with their pressures."""
    every = torch.stack(list(h))
    if not solid.projects:
        return list(_by_law(solid, _changes, points, every))
    cofactor = cofactors(points.f)
    dilation = torch.stack([solid.projected((cofactor * each).sum((0, 1))) for each in h])
    slopes = _by_law(solid, _slopes, points, every, dilation)
    pressures = torch.stack([solid.projected(each) for each in slopes])
    found = _by_law(solid, _changes, points, every, dilation)
    return [p + x * cofactor for p, x in zip(found, pressures, strict=True)]


def _by_law(
    solid: Solid,
    function: Callable[[Points, Law, Tensor, Tensor | None], Tensor],
    points: Points,
    h: Tensor,
    dilation: Tensor | None = None,
) -> Tensor:
    """A function of the points of every law; H and δθ have their own axis in front."""
    if len(solid.materials) == 1:
        return function(points, solid.laws[0], h, dilation)
    parts = [
        function(
            points.of(some),
            law,
            h[..., some, :, :],
            None if dilation is None else dilation[..., some, :, :],
        )
        for some, law in zip(solid.members, solid.laws, strict=True)
    ]
    return solid.joined(parts)


def _second_changes(
    state: Deformation, law: Law, outputs: list[Tensor], h: Tensor, dilation: Tensor | None
) -> dict[int, Tensor]:
    """δψ_a of the derivatives that change."""
    second = law.second(outputs)
    numbers = sorted({n for pair in second for n in pair})
    by = state.changes(h, numbers)
    if dilation is not None:
        by[DILATION] = dilation
    found: dict[int, Tensor] = {}
    for (a, b), factor in second.items():
        for x, y in {(a, b), (b, a)}:
            if y in by:
                found[x] = found.get(x, 0) + factor * by[y]
    return found


def _slopes(points: Points, law: Law, h: Tensor, dilation: Tensor | None) -> Tensor:
    """Changes of ∂W/∂θ: (n, d, d, n_cells, N, n_points) → (n, n_cells, N, n_points)."""
    state = points.state(law)
    outputs = law.energy(state.measures, torch)
    assert dilation is not None
    return torch.stack(
        [
            torch.zeros_like(state.j) + _second_changes(state, law, outputs, one, d)[DILATION]
            for one, d in zip(h, dilation, strict=True)
        ]
    )


def _changes(points: Points, law: Law, h: Tensor, dilation: Tensor | None) -> Tensor:
    """δP at fixed p: (n, d, d, n_cells, N, n_points) → same."""
    state = points.state(law)
    outputs = law.energy(state.measures, torch)
    first = with_pressure_of(outputs[1 : 1 + law.count], points)
    found = []
    for number, one in enumerate(h):
        change = None if dilation is None else dilation[number]
        of = _second_changes(state, law, outputs, one, change)
        factors = [of.get(a, 0.0) for a in range(law.count)]
        found.append(state.turned(one, first) + state.stress(factors))
    return torch.stack(found)
