"""Equilibria by torch-fem (https://github.com/meyer-nils/torch-fem)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from measured import measured
from torchfem import Planar, Solid
from torchfem.materials import Hyperelastic3D, HyperelasticPlaneStrain

STEPS = 5


def energy(f: torch.Tensor, moduli: torch.Tensor) -> torch.Tensor:
    """ψ = μ/2 (tr C − 3 − 2 ln J) + λ/4 (J² − 1 − 2 ln J)."""
    (mu, lam), j = moduli, torch.dot(f[0], torch.linalg.cross(f[1], f[2]))
    neo = mu / 2 * ((f * f).sum() - 3 - 2 * torch.log(j))
    return neo + lam / 4 * (j**2 - 1 - 2 * torch.log(j))


def prepared(p: dict[str, Any]) -> Callable[[Any], Any]:
    """Return what solves one load."""
    torch.set_default_dtype(torch.float64)
    mu = p["young"] / 2 / (1 + p["poisson"])
    lam = 2 * mu * p["poisson"] / (1 - 2 * p["poisson"])
    x, cells = torch.from_numpy(p["x"]), torch.from_numpy(p["cells"])
    if x.shape[1] == 2:
        body = Planar(x, cells, HyperelasticPlaneStrain(energy, [mu, lam]))
    else:
        body = Solid(x, cells, Hyperelastic3D(energy, [mu, lam]))
    body.constraints = torch.from_numpy(p["held"])

    def solve(force: Any) -> Any:
        body.forces = torch.from_numpy(force)
        found = body.solve(torch.linspace(0, 1, STEPS + 1), rtol=1e-8, max_iter=20)
        return found[0].detach().numpy()

    return solve


measured(prepared)
