"""Fields at the quadrature points of one load, in loops that Numba compiles.

On small bodies NumPy and PyTorch spend most of the time between their sums, on large ones they read
and write every field once an operation. The compiled functions add to fields in place. They are
compiled at their first call, which takes some seconds once for an installation: the results are
kept beside the code, or else in the user's cache.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[Any]  # of one precision
Function = TypeVar("Function", bound=Callable[..., object])
SUMS = {"reassoc", "contract", "arcp", "nsz"}  # in any order; infinite numbers are kept


def compiled(function: Function) -> Function:
    """Compile a function of numbers and arrays at its first call."""
    try:
        made = njit(function, cache=True, fastmath=SUMS, error_model="numpy")
    except RuntimeError:  # no folder can be written
        made = njit(function, fastmath=SUMS, error_model="numpy")
    return cast(Function, made)


@compiled
def add_trace(factor: float, a: Array, out: Array) -> None:
    """Add x tr A: (d, d, n_points) → (n_points,)."""
    x = out.dtype.type(factor)  # numbers in double precision would make all sums double
    for i in range(a.shape[0]):
        for q in range(a.shape[2]):
            out[q] += x * a[i, i, q]


@compiled
def add_linear_cofactors(a: Array, out: Array) -> None:
    """Add (tr A) I - Aᵀ: (d, d, n_points) → same."""
    d, _, points = a.shape
    for i in range(d):
        for j in range(d):
            if i == j:
                for k in range(d):
                    if k != i:
                        for q in range(points):
                            out[i, i, q] += a[k, k, q]
            else:
                for q in range(points):
                    out[i, j, q] -= a[j, i, q]


@compiled
def add_minors(factor: float, a: Array, b: Array, out: Array) -> None:
    """Add x (A_km B_nr - A_kr B_nm), (k, n) and (m, r) after i and j, of A and B in space."""
    x = out.dtype.type(factor)
    for i in range(3):
        k, n = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            m, r = (j + 1) % 3, (j + 2) % 3
            for q in range(a.shape[2]):
                out[i, j, q] += x * (a[k, m, q] * b[n, r, q] - a[k, r, q] * b[n, m, q])


@compiled
def add_cross_product(factor: float, a: Array, b: Array, out: Array) -> None:
    """Add x A × B in space: (3, 3, n_points) twice → same; A × A = 2 cof A."""
    add_minors(factor, a, b, out)
    add_minors(factor, b, a, out)


@compiled
def add_contraction(factor: float, a: Array, b: Array, out: Array) -> None:
    """Add x A : B: (d, d, n_points) twice → (n_points,)."""
    x, (d, _, points) = out.dtype.type(factor), a.shape
    for i in range(d):
        for j in range(d):
            for q in range(points):
                out[q] += x * a[i, j, q] * b[i, j, q]


@compiled
def integral(a: Array, b: Array, weights: Array) -> float:
    """Sum of weighted products: (n_points,) thrice → number in double precision."""
    total = 0.0
    for q in range(len(weights)):
        total += weights[q] * a[q] * b[q]
    return total


@compiled
def weighted_sums(sources: NDArray[np.int64], weights: Array, x: Array) -> Array:
    """Sum a few values for every output: (k, n_out) twice, (n_in,) → (n_out,)."""
    y = np.zeros(weights.shape[1], x.dtype)
    for k in range(len(weights)):
        for i in range(len(y)):
            y[i] += weights[k, i] * x[sources[k, i]]
    return y


@compiled
def slopes_in_cells(cells: NDArray[np.int64], gradients: Array, u: Array) -> Array:
    """Gradients at the quadrature points: (n_nodes, d) → (d, d, n_cells · n_points).

    Parameters
    ----------
    cells : array of int, (n_cells, n_corners)
    gradients : array, (n_cells, n_corners, d, n_points)
        Of the shape functions.
    u : array, (n_nodes, d)
    """
    count, corners, d, points = gradients.shape
    out = np.zeros((d, d, count * points), u.dtype)
    for c in range(count):
        for a in range(corners):
            for i in range(d):
                x = u[cells[c, a], i]
                for j in range(d):
                    for q in range(points):
                        out[i, j, c * points + q] += x * gradients[c, a, j, q]
    return out


@compiled
def forces_of_cells(
    cells: NDArray[np.int64], gradients: Array, volumes: Array, stress: Array, nodes: int
) -> Array:
    """Forces of stresses: (d, d, n_cells · n_points) → (n_nodes, d).

    Parameters
    ----------
    cells, gradients : array
        As of `slopes_in_cells`.
    volumes : array, (n_cells · n_points,)
    stress : array, (d, d, n_cells · n_points)
    nodes : int
    """
    count, corners, d, points = gradients.shape
    out = np.zeros((nodes, d), stress.dtype)
    weighted = np.empty((d, d, points), stress.dtype)
    for c in range(count):
        for i in range(d):
            for j in range(d):
                for q in range(points):
                    p = c * points + q
                    weighted[i, j, q] = stress[i, j, p] * volumes[p]
        for a in range(corners):
            for i in range(d):
                total = stress.dtype.type(0)
                for j in range(d):
                    for q in range(points):
                        total += weighted[i, j, q] * gradients[c, a, j, q]
                out[cells[c, a], i] += total
    return out
