"""Prediction with a trained network: nodal forces in, nodal displacements out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from shared_schema.errors import InputError, first_line
from surrogate.field_network import FieldNetwork
from surrogate.geometry import PREFIX, Geometry
from surrogate.network import make_network
from surrogate.run_description import RunDescription
from surrogate.run_folder import RunFolder

BATCH = 4096


class Surrogate:
    """A trained network with the mesh that it predicts on.

    Attributes
    ----------
    geometry : Geometry
        Mesh, supports and grid; forces and displacements are numbered as its nodes are.
    description : RunDescription
        What it was made from.
    """

    def __init__(
        self, network: FieldNetwork, geometry: Geometry, description: RunDescription
    ) -> None:
        self.network = network.eval()
        self.geometry = geometry
        self.description = description

    def predict(self, forces: ArrayLike) -> NDArray[np.float64]:
        """Predict displacements.

        Parameters
        ----------
        forces : array, (n_nodes, d) or (N, n_nodes, d)
            Nodal forces in N.

        Returns
        -------
        array of the same shape
            Nodal displacements in m.

        Raises
        ------
        InputError
            If the shape is wrong or a force is not finite.
        """
        try:
            nodal = np.asarray(forces, dtype=np.float64)
        except ValueError as error:
            raise InputError(f"forces are no array of numbers ({first_line(error)})") from None
        expected = self.geometry.coordinates.shape
        if nodal.ndim not in (2, 3) or nodal.shape[-2:] != expected:
            raise InputError(f"forces have shape {nodal.shape}, expected {expected} or (N, *)")
        if not np.all(np.abs(nodal) < np.finfo(np.float32).max):  # false for NaN as well
            raise InputError("forces hold a NaN or an infinity, expected finite numbers in N")
        grid = self.geometry.grid.forces_to_grid(nodal.reshape(-1, *expected)).astype(np.float32)
        device = self.network.free.device
        with torch.no_grad():
            parts = [
                self.network(torch.from_numpy(part).to(device)).cpu().numpy()
                for part in np.split(grid, range(BATCH, len(grid), BATCH))
            ]
        predicted = self.geometry.grid.to_nodes(np.concatenate(parts))
        return predicted.astype(np.float64).reshape(nodal.shape)

    def outside_training(self, forces: NDArray[np.float64]) -> str | None:
        """Say in which way forces leave what the network was trained on, if they do.

        Parameters
        ----------
        forces : array, (n_nodes, d)
            In N.
        """
        limit = self.description.data.info.force.max_abs
        largest = np.abs(forces).max(axis=0)
        if np.any(largest > np.asarray(limit) * (1 + 1e-6)):
            allowed = ", ".join(f"{value:.3g}" for value in limit)
            return f"force components reach beyond those of the training data (±{allowed} N)"
        loaded = forces.any(axis=1)
        if np.any(loaded & ~self.geometry.loadable):
            return "a loaded node was never loaded in the training data"
        return None


def load(run: str | Path, device: str = "cpu") -> Surrogate:
    """Load a trained network from its run folder; nothing is unpickled.

    Raises
    ------
    InputError
        If there is no finished run, or it is damaged.
    """
    folder = RunFolder(Path(run))
    description = folder.description()
    tensors = folder.read_tensors()
    try:
        geometry = Geometry.from_tensors(tensors, description.data.cell_type)
        network = make_network(description, geometry)
        weights = {k: v for k, v in tensors.items() if not k.startswith(PREFIX)}
        network.load_state_dict(weights)
    except (KeyError, IndexError, RuntimeError, ValueError) as error:
        raise InputError(
            f"{folder.model}: does not fit {folder.config.name} ({first_line(error)})"
        ) from None
    return Surrogate(network.to(device), geometry, description)
