r"""Cofactors of tensors at points, (…, d, d, n_points), in PyTorch.

.. math::
    \mathrm{cof} (A + B) = \mathrm{cof} A + A × B + \mathrm{cof} B, \qquad
    I × A = (\mathrm{tr} A) I - A^T

with the cross product of tensors in space (J. Bonet, A. J. Gil and R. Ortigosa, *A computational
framework for polyconvex large strain elasticity*, CMAME 283, 2015). In the plane the cofactors are
linear, :math:`\mathrm{cof} A = (\mathrm{tr} A) I - A^T`.
"""

from __future__ import annotations

import torch
from torch import Tensor

SIGNS = [[[1.0], [-1.0]], [[-1.0], [1.0]]]


def trace(a: Tensor) -> Tensor:
    """Tr A: (…, d, d, n_points) → (…, n_points)."""
    total = a[..., 0, 0, :] + a[..., 1, 1, :]
    return total if a.shape[-2] == 2 else total + a[..., 2, 2, :]


def linear_cofactors(a: Tensor) -> Tensor:
    """(tr A) I - Aᵀ, the cofactors in the plane: (…, d, d, n_points) → same."""
    if a.shape[-2] > 2:
        return add_multiple(-a.transpose(-2, -3), trace(a))
    signs = torch.tensor(SIGNS, dtype=a.dtype, device=a.device)
    return a.flip(-2, -3) * signs


def add_multiple(a: Tensor, factor: Tensor) -> Tensor:
    """A + x I: (…, d, d, n_points), (…, n_points) → (…, d, d, n_points)."""
    unit = torch.eye(a.shape[-2], dtype=a.dtype, device=a.device)
    return a + unit[:, :, None] * factor[..., None, None, :]


def cofactors(a: Tensor) -> Tensor:
    """Cof A in space: (…, 3, 3, n_points) → same."""
    return _minors(a, a)


def cross_product(a: Tensor, b: Tensor) -> Tensor:
    """A × B in space: (…, 3, 3, n_points) twice → same."""
    return _minors(a, b) + _minors(b, a)


def contraction(a: Tensor, b: Tensor) -> Tensor:
    """A : B: (…, d, d, n_points) twice → (…, n_points)."""
    return (a * b).sum((-2, -3))


def _minors(a: Tensor, b: Tensor) -> Tensor:
    """A_im B_jn - A_in B_jm: (…, 3, 3, n_points) twice → same; (i, j) and (m, n) turn with each."""
    return torch.linalg.cross(a.roll(-1, -3), b.roll(-2, -3), dim=-2)
