r"""Prediction with a trained network: nodal forces in, distributions of nodal displacements out.

Of T stochastic passes with means :math:`μ_t` and standard deviations :math:`σ_t`,

.. math:: \bar μ = \frac{1}{T} \sum_t μ_t, \qquad
   σ^2 = \underbrace{\frac{1}{T-1} \sum_t (μ_t - \bar μ)^2}_{\text{epistemic}}
       + \underbrace{\frac{1}{T} \sum_t σ_t^2}_{\text{aleatoric}}

(Deshpande et al. 2022, Section 2.5; Kendall and Gal 2017).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from shared_schema.errors import InputError, first_line
from surrogate.field_network import FieldNetwork
from surrogate.geometry import PREFIX, Geometry
from surrogate.network import make_network
from surrogate.passes import drawables, drawn
from surrogate.run_description import RunDescription
from surrogate.run_folder import RunFolder

BATCH = 4096  # samples times passes at once
PASSES = 300
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Distribution:
    """A Gaussian for every displacement component.

    Attributes
    ----------
    mean, std_epistemic, std_aleatoric : array, (n_nodes, d) or (N, n_nodes, d)
        In m: mean, and standard deviations from the weights' spread and from the data's.
    """

    mean: Array
    std_epistemic: Array
    std_aleatoric: Array

    @property
    def std(self) -> Array:
        """Total standard deviation in m."""
        return np.hypot(self.std_epistemic, self.std_aleatoric)

    def fields(self) -> dict[str, Array]:
        """The arrays by the names that they have in files."""
        return {
            "displacement": self.mean,
            "std": self.std,
            "std_epistemic": self.std_epistemic,
            "std_aleatoric": self.std_aleatoric,
        }


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

    @property
    def is_probabilistic(self) -> bool:
        """Whether it predicts standard deviations."""
        return self.is_stochastic or self.description.run.likelihood != "deterministic"

    @property
    def is_stochastic(self) -> bool:
        """Whether passes differ."""
        return bool(drawables(self.network))

    def predict(self, forces: ArrayLike) -> Array:
        """Predict displacements: the mean of `predict_distribution`.

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
        return self.predict_distribution(forces).mean

    def predict_distribution(
        self, forces: ArrayLike, passes: int = PASSES, seed: int = 0
    ) -> Distribution:
        """Predict means and standard deviations of displacements.

        Parameters
        ----------
        forces : array, (n_nodes, d) or (N, n_nodes, d)
            Nodal forces in N.
        passes : int
            T; a network that is not stochastic makes one.
        seed : int
            Of the passes. The same passes serve all samples.

        Raises
        ------
        InputError
            If the shape is wrong, a force is not finite, or there is no pass.
        """
        if passes < 1:
            raise InputError(f"passes = {passes}, expected 1 at least")
        nodal = self._checked(forces)
        samples = nodal.reshape(-1, *self.geometry.coordinates.shape)
        passes = passes if self.is_stochastic else 1
        parts = [
            self._distribution(samples[start : start + BATCH], passes, seed)
            for start in range(0, max(len(samples), 1), BATCH)
        ]
        mean, epistemic, aleatoric = (
            np.concatenate(fields).reshape(nodal.shape) for fields in zip(*parts, strict=True)
        )
        return Distribution(mean, epistemic, aleatoric)

    def _checked(self, forces: ArrayLike) -> Array:
        try:
            nodal = np.asarray(forces, dtype=np.float64)
        except ValueError as error:
            raise InputError(f"forces are no array of numbers ({first_line(error)})") from None
        expected = self.geometry.coordinates.shape
        if nodal.ndim not in (2, 3) or nodal.shape[-2:] != expected:
            raise InputError(f"forces have shape {nodal.shape}, expected {expected} or (N, *)")
        if not np.all(np.abs(nodal) < np.finfo(np.float32).max):  # false for NaN as well
            raise InputError("forces hold a NaN or an infinity, expected finite numbers in N")
        return nodal

    def _distribution(self, nodal: Array, passes: int, seed: int) -> tuple[Array, Array, Array]:
        """Mean, epistemic and aleatoric standard deviation of one batch, over all passes."""
        grid = self.geometry.grid.forces_to_grid(nodal).astype(np.float32)
        force = torch.from_numpy(grid).to(self.network.free.device)
        at_once = max(1, BATCH // max(len(nodal), 1))
        mean, squares, variance = (np.zeros(nodal.shape) for _ in range(3))
        for start in range(0, passes, at_once):
            chunk = range(start, min(start + at_once, passes))
            means, stds = self._pass(force, seed, chunk)
            here = means.mean(axis=0)
            offset = here - mean
            done = start + len(chunk)
            squares += ((means - here) ** 2).sum(axis=0)
            squares += offset**2 * (start * len(chunk) / done)
            mean += offset * (len(chunk) / done)
            variance += (stds**2).sum(axis=0) / passes
        return mean, np.sqrt(squares / max(passes - 1, 1)), np.sqrt(variance)

    @torch.no_grad()
    def _pass(self, force: Tensor, seed: int, passes: Sequence[int]) -> tuple[Array, Array]:
        """Means and aleatoric standard deviations of some passes, (passes, N, n_nodes, d) each."""
        tiled = force.repeat(len(passes), *[1] * (force.ndim - 1))
        with drawn(self.network, seed, passes):
            prediction = self.network(tiled)
        shape = (len(passes), len(force), *self.geometry.coordinates.shape)

        def at_nodes(field: Tensor | None) -> Array:
            if field is None:
                return np.zeros(shape)
            return self.geometry.grid.to_nodes(field.cpu().double().numpy()).reshape(shape)

        return at_nodes(prediction.mean), at_nodes(prediction.std)

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
