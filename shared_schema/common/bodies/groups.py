"""Named groups of nodes in a dataset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]


def groups_of(arrays: Arrays) -> dict[str, NDArray[np.bool_]]:
    """Nodes of every named group of a shard's mesh, (n_nodes,) each; none in older datasets."""
    if "mesh/groups" not in arrays:
        return {}
    names = [str(name) for name in arrays["mesh/group_names"]]
    return dict(zip(names, arrays["mesh/groups"], strict=True))


def group_arrays(groups: Mapping[str, NDArray[np.bool_]]) -> Arrays:
    """Arrays of named groups by their paths in a shard; none if there are no groups."""
    if not groups:
        return {}
    names = sorted(groups)
    return {
        "mesh/group_names": np.array(names, dtype=object),
        "mesh/groups": np.stack([groups[name] for name in names]),
    }
