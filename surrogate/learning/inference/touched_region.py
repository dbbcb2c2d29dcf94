"""Columns of the compliance at the nodes that tools reach, kept with a network and its run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from shared_schema.common.errors import InputError
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.shelf import is_shelved
from surrogate.mechanics.equilibrium.compliance import Compliance
from surrogate.runtime.tensor_file import load_tensors, serialised

if TYPE_CHECKING:
    from surrogate.learning.inference.surrogate import Surrogate

INPUTS, COLUMNS = "inputs", "columns"


def keep_columns(model: Surrogate, nodes: str | ArrayLike) -> None:
    """Solve for the columns of the forces at some nodes, and keep them; see `prepare`."""
    compliance = compliance_of(model)
    if compliance.is_small:
        return
    inputs = compliance.inputs_at(model.geometry.nodes_of(nodes))
    columns = compliance.kept.keep(inputs)
    of_one_shape = model.geometry.shapes is None
    if of_one_shape and model.folder is not None and not is_shelved(model.folder):
        dofs, place = by_component(model), np.zeros(model.geometry.coordinates.size, np.int64)
        place[dofs] = np.arange(len(dofs))
        found = {INPUTS: place[inputs], COLUMNS: columns[:, dofs]}
        tensors = {name: torch.from_numpy(array) for name, array in found.items()}
        RunFolder(model.folder).write_columns(serialised(tensors))


def restore_columns(model: Surrogate, run: RunFolder) -> None:
    """Keep the columns in a run's folder; InputError if the file is damaged."""
    if not run.columns.is_file():
        return
    run.seal.require_intact(run.columns)
    tensors, _ = load_tensors(run.columns)
    try:
        dofs, known = by_component(model), tensors[COLUMNS].numpy()
        columns = np.zeros((len(known), model.geometry.coordinates.size), known.dtype)
        columns[:, dofs] = known
        compliance_of(model).kept.keep(dofs[tensors[INPUTS].numpy()], columns)
    except (KeyError, IndexError, ValueError) as error:
        raise InputError(f"{run.columns}: does not fit {run.model.name} ({error})") from None


def by_component(model: Surrogate) -> NDArray[np.int64]:
    """Degrees of freedom of the nodes that can move, as files number them."""
    free, d = np.flatnonzero(~model.geometry.clamped), model.geometry.dimension
    return (free * d + np.arange(d)[:, None]).ravel()


def compliance_of(model: Surrogate) -> Compliance:
    """The compliance that predictions solve with; InputError if there is none."""
    linear = model.network.linear
    compliance = None if linear is None else linear.compliance
    if not isinstance(compliance, Compliance) or not model.geometry.grid.points_are_nodes:
        raise InputError(
            "prepare: expected a network on its own nodes, on the CPU, that begins with the "
            "linear response or the load series"
        )
    return compliance
