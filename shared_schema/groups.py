"""Named groups of nodes in a dataset."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared_schema.layout import Arrays


def groups_of(arrays: Arrays) -> dict[str, NDArray[np.bool_]]:
    """Nodes of every named group of a shard's mesh, (n_nodes,) each; none in older datasets."""
    if "mesh/groups" not in arrays:
        return {}
    names = [str(name) for name in arrays["mesh/group_names"]]
    return dict(zip(names, arrays["mesh/groups"], strict=True))
