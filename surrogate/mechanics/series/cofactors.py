r"""Cofactors of tensors at points, (…, d, d, n_points), in NumPy and PyTorch.

.. math::
    \mathrm{cof} (A + B) = \mathrm{cof} A + A × B + \mathrm{cof} B, \qquad
    I × A = (\mathrm{tr} A) I - A^T

with the cross product of tensors in space (J. Bonet, A. J. Gil and R. Ortigosa, *A computational
framework for polyconvex large strain elasticity*, CMAME 283, 2015). In the plane the cofactors are
linear, :math:`\mathrm{cof} A = (\mathrm{tr} A) I - A^T`.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import torch

from surrogate.mechanics.series.arrays import constant, library_of

Array = Any  # of NumPy, or a Tensor
TURNS = (1, 2), (2, 0), (0, 1)
SIGNS = np.array([[[1.0], [-1.0]], [[-1.0], [1.0]]])


def trace(a: Array) -> Array:
    """Tr A: (…, d, d, n_points) → (…, n_points)."""
    total = a[..., 0, 0, :] + a[..., 1, 1, :]
    return total if a.shape[-2] == 2 else total + a[..., 2, 2, :]


def linear_cofactors(a: Array) -> Array:
    """(tr A) I - Aᵀ, the cofactors in the plane: (…, d, d, n_points) → same."""
    if a.shape[-2] > 2:
        return add_multiple(-a.swapaxes(-2, -3), trace(a))
    turned = a.flip(-2, -3) if isinstance(a, torch.Tensor) else a[..., ::-1, ::-1, :]
    return turned * constant(SIGNS, a)


def add_multiple(a: Array, factor: Array) -> Array:
    """A + x I, of an array in place: (…, d, d, n_points), (…, n_points) → (…, d, d, n_points)."""
    if isinstance(a, torch.Tensor):
        unit = torch.eye(a.shape[-2], dtype=a.dtype, device=a.device)
        return a + unit[:, :, None] * factor[..., None, None, :]
    for i in range(a.shape[-2]):
        a[..., i, i, :] += factor
    return a


def cofactors(a: Array) -> Array:
    """Cof A in space: (…, 3, 3, n_points) → same."""
    return _minors(a, a)


def cross_product(a: Array, b: Array) -> Array:
    """A × B in space: (…, 3, 3, n_points) twice → same."""
    found = _minors(a, b)
    found += _minors(b, a)
    return found


def contraction(a: Array, b: Array) -> Array:
    """A : B: (…, d, d, n_points) twice → (…, n_points)."""
    if library_of(a) is np:
        return np.einsum("...ijq,...ijq->...q", a, b)
    return (a * b).sum((-2, -3))


def _minors(a: Array, b: Array) -> Array:
    """A_im B_jn - A_in B_jm: (…, 3, 3, n_points) twice → same; (i, j) and (m, n) turn with each."""
    if isinstance(a, torch.Tensor):
        return torch.linalg.cross(a.roll(-1, -3), b.roll(-2, -3), dim=-2)
    turns = product(TURNS, TURNS)
    found, second = np.empty_like(a, order="C"), np.empty_like(a[..., 0, 0, :], order="C")
    for place, ((i, j), (m, n)) in zip(np.ndindex(3, 3), turns, strict=True):
        first = found[(..., *place, slice(None))]
        np.multiply(a[..., i, m, :], b[..., j, n, :], out=first)
        np.multiply(a[..., i, n, :], b[..., j, m, :], out=second)
        first -= second
    return found
