"""Values of the components of displacement that are not held, of fields on the grid or at nodes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor


def at_components(fields: Tensor, components: Tensor) -> Tensor:
    """Return some components of fields, by their numbers: (N, d, nx, ny[, nz]) → (N, n)."""
    return fields.flatten(1).index_select(1, components)


def by_component(free: NDArray[np.bool_], dimension: int) -> NDArray[np.bool_]:
    """Return the free components, (n_nodes, d); of a mask of nodes, (n_nodes,), all of theirs."""
    return free if free.ndim == 2 else np.repeat(free[:, None], dimension, axis=1)


def at_free(values: NDArray[Any], free: NDArray[np.bool_]) -> NDArray[Any]:
    """Return values of the free components of every sample, (M, n_nodes, d) → (M, …, …).

    Parameters
    ----------
    values : array, (M, n_nodes, d)
    free : array of bool, (n_nodes, d) or (n_nodes,)
        Components that are not held, or nodes.

    Returns
    -------
    array, (M, n_free_nodes, d) or (M, n_free_components, 1)
        By nodes if no node is held in single components only, else by components.
    """
    whole = free.all(axis=1) if free.ndim == 2 else free
    if free.ndim == 1 or np.array_equal(whole, free.any(axis=1)):
        return np.asarray(values[:, whole])
    return np.asarray(values[:, free][..., None])


def require_positive(std: NDArray[np.float64], free: NDArray[np.bool_]) -> None:
    """Raise ValueError unless σ, (M, n_nodes, d), is positive and finite where it is free."""
    wrong = ~(np.isfinite(std) & (std > 0)) & by_component(free, std.shape[-1])
    if np.any(wrong):
        first = tuple(int(index) for index in np.argwhere(wrong)[0])
        raise ValueError(
            f"std of (sample, node, component) {first} is {std[first]}, expected a positive number"
        )
