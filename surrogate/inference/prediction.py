"""Prediction with a trained network: distributions of nodal displacements from nodal forces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.common.errors import InputError, first_line
from surrogate.certify.certificate import Certificate, certify
from surrogate.certify.correction import Correction, correct
from surrogate.data.elements_of_case import require_known_elements, require_linear_elements
from surrogate.data.geometry import Geometry
from surrogate.device import convolutions
from surrogate.inference.training_range import TrainingRange
from surrogate.mechanics.compliance import Compliance
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.mechanics.solids.solid import Solid
from surrogate.mechanics.stresses import cell_stresses, reactions
from surrogate.networks.field_network import FieldNetwork
from surrogate.networks.nodal_network import NodalNetwork
from surrogate.networks.unet import parameter_count
from surrogate.one_load.backend import OneLoad, in_numpy
from surrogate.probabilistic.likelihoods import Prediction
from surrogate.probabilistic.moments import Moments
from surrogate.probabilistic.stochastic_passes import Passes
from surrogate.runs.description import RunDescription

BATCH = 4096  # largest product of samples and passes that are computed at once
VALUES = 2**25  # largest number of values in a layer
PASSES = 300
LARGEST_FORCE = float(np.finfo(np.float32).max)
MOST_PASSES, MOST_SEED = 10**6, 2**63 - 1
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Distribution:
    """A Gaussian for every displacement component.

    Attributes
    ----------
    mean, std_epistemic, std_aleatoric : array, (n_nodes, d) or (N, n_nodes, d)
        Mean, and standard deviations due to random weights (epistemic) and to noise of the data
        (aleatoric), in m.
    """

    mean: Array
    std_epistemic: Array
    std_aleatoric: Array

    @property
    def std(self) -> Array:
        """Total standard deviation in m."""
        return np.hypot(self.std_epistemic, self.std_aleatoric)

    def fields(self) -> dict[str, Array]:
        """Return the arrays by their names in solution files."""
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
    network : FieldNetwork
    nodal_network : NodalNetwork
        The same network as a map between fields at the nodes of the mesh.
    passes : Passes
        Passes of the network; the drawn weights of the last prediction are kept.
    geometry : Geometry
        Mesh, supports and grid; its node numbers are those of forces and displacements.
    description : RunDescription
        Configuration and dataset of the run.
    training_range : TrainingRange
        Forces of the training data; `predict` warns of others.
    mean_error : float or None
        ē on the test split of its training's dataset, in m; None if the run is not evaluated.
    """

    def __init__(
        self, network: FieldNetwork, geometry: Geometry, description: RunDescription
    ) -> None:
        self.network = network.eval()
        self.nodal_network = NodalNetwork(network, geometry.grid).to(network.free.device)
        self.geometry = geometry
        self.description = description
        data = description.data
        self.training_range = TrainingRange(
            data.info.force.max_abs, geometry.loadable, data.loads, geometry.grid
        )
        self.passes = Passes(network)
        self._held = np.flatnonzero(geometry.held)  # degrees of freedom, node · d + component
        self.mean_error: float | None = None

    def __repr__(self) -> str:
        """Say what it is, such as "Surrogate(beam2d, 64 nodes, U-Net 0.47 M, ē 0.06 mm)"."""
        run = self.description.run
        size = f"{run.title} {parameter_count(self.network) / 1e6:.2f} M"
        parts = [run.case, f"{len(self.geometry.coordinates)} nodes", size]
        if run.likelihood != "deterministic":
            parts.append(run.likelihood.replace("_", " "))
        if self.mean_error is not None:
            parts.append(f"ē {1e3 * self.mean_error:.2g} mm")
        return f"Surrogate({', '.join(parts)})"

    @property
    def is_probabilistic(self) -> bool:
        """True if the network predicts standard deviations."""
        return self.is_stochastic or self.description.run.predicts_std

    @property
    def is_stochastic(self) -> bool:
        """True if passes differ from each other."""
        return self.passes.differ

    def predict(self, forces: ArrayLike) -> Array:
        """Predict displacements, the means of `predict_distribution`.

        Under a single load, a U-Net or reduced network that is not stochastic predicts in NumPy on
        a CPU, a load series by code that Numba compiles, in some seconds, at the first prediction
        after an installation (`surrogate.one_load.backend`). Rounding of single precision is all
        that differs from `predict_distribution`.

        Issues an `OutsideTrainingWarning`, once a kind, for forces unlike those of the training.

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
            If the shape is wrong, a force is not finite, or one acts at a clamped node.
        """
        nodal = self._checked(forces)
        self.training_range.warn(nodal)
        return self._mean(nodal)

    def _mean(self, nodal: Array) -> Array:
        """Predict without warnings."""
        if self._is_one(nodal) and self._one_load is not None:
            return self._one_load(nodal.reshape(nodal.shape[-2:])).reshape(nodal.shape)
        return self._predicted(nodal, PASSES, 0).mean

    @cached_property
    def equilibrium(self) -> Equilibrium:
        """The finite-element equilibrium of the body.

        Raises
        ------
        InputError
            If its material is none of the shipped ones, or the learner does not compute the
            equilibria of its elements.
        """
        require_known_elements(self.description.data.case, self.geometry)
        whole = self.geometry.mean_dilation
        for module in self.network.modules():
            if isinstance(module, Compliance) and module.equilibrium.mean_dilation == whole:
                return module.equilibrium
        return Equilibrium(self.geometry, self.description.data.material)

    @property
    def stressed(self) -> Solid:
        """The solid whose stresses are known.

        Raises
        ------
        InputError
            If its material is none of the shipped ones, or its elements are not linear.
        """
        require_linear_elements(self.description.data.case, "stresses and reactions")
        return self.equilibrium.solid

    def balanced(self) -> Equilibrium:
        """Equilibrium under dead loads; InputError if the case has loads that follow the body."""
        if self.geometry.pressed is not None:
            raise InputError(
                "the loads of the case have a pressure that follows the surface, so that the "
                "forces of a prediction cannot be balanced; expected dead loads"
            )
        return self.equilibrium

    def certify(self, forces: ArrayLike, predicted: ArrayLike | None = None) -> Certificate:
        """Estimate the errors of predictions from their out-of-balance forces.

        Parameters
        ----------
        forces : array, (n_nodes, d) or (N, n_nodes, d)
            Nodal forces in N.
        predicted : array of the same shape, optional
            Displacements in m; by default those of `predict`.

        Raises
        ------
        InputError
            If a shape is wrong, a force is not finite, or the run does not name its material.
        """
        equilibrium = self.balanced()
        nodal, displacement = self._with_predicted(forces, predicted)
        return certify(equilibrium, nodal, displacement)

    def correct(self, forces: ArrayLike, predicted: ArrayLike | None = None) -> Correction:
        """Go on from a prediction to the finite elements' equilibrium.

        Parameters
        ----------
        forces : array, (n_nodes, d)
            Nodal forces in N.
        predicted : array of the same shape, optional
            Displacements in m, which may be wrong; by default those of `predict`.

        Raises
        ------
        InputError
            As `certify`.
        WorkError
            If no equilibrium is found.
        """
        equilibrium = self.balanced()
        nodal, displacement = self._with_predicted(forces, predicted)
        if nodal.ndim != 2:
            raise InputError(f"forces have shape {nodal.shape}, expected {nodal.shape[1:]}")
        return correct(equilibrium, nodal, displacement)

    def stresses(self, displacement: ArrayLike) -> dict[str, Array]:
        """Compute stresses at the middle of every cell.

        Parameters
        ----------
        displacement : array, (n_nodes, d) or (N, n_nodes, d)
            In m.

        Returns
        -------
        dict of array, (n_cells, …) or (N, n_cells, …)
            By the names of `shared_schema.common.bodies.stress_fields`.

        Raises
        ------
        InputError
            If the material is none of the shipped ones.
        """
        u = np.asarray(displacement, dtype=np.float64)
        samples = u.reshape(-1, *self.geometry.coordinates.shape)
        fields = cell_stresses(self.stressed, self.geometry, samples)
        return {name: values[0] if u.ndim == 2 else values for name, values in fields.items()}

    def reactions(self, displacement: ArrayLike, pushed: ArrayLike | None = None) -> Array:
        """Compute the forces of the supports on the body, (n_nodes, d) in N.

        Parameters
        ----------
        displacement : array, (n_nodes, d)
            In m.
        pushed : array, (n_nodes, d), optional
            Forces in N of pressures on the deformed body; none by default.
        """
        u = np.asarray(displacement, dtype=np.float64)
        forces = np.zeros(u.shape) if pushed is None else np.asarray(pushed, dtype=np.float64)
        of_sample: Array = reactions(self.stressed, self.geometry, u[None], forces[None])[0]
        return of_sample

    def _with_predicted(
        self, forces: ArrayLike, predicted: ArrayLike | None
    ) -> tuple[Array, Array]:
        """Return forces and displacements, checked; predict them if they are not given."""
        nodal = self._checked(forces)
        if predicted is None:
            return nodal, self._mean(nodal)
        displacement = np.asarray(predicted, dtype=np.float64)
        if displacement.shape != nodal.shape:
            raise InputError(f"predicted has shape {displacement.shape}, expected {nodal.shape}")
        return nodal, displacement

    def predict_distribution(
        self, forces: ArrayLike, passes: int = PASSES, seed: int = 0
    ) -> Distribution:
        """Predict means and standard deviations of displacements.

        Parameters
        ----------
        forces : array, (n_nodes, d) or (N, n_nodes, d)
            Nodal forces in N.
        passes : int
            Number of passes T of every member of an ensemble; a network that is not stochastic
            makes a single pass.
        seed : int
            Seed of the passes, 0 or more. All samples use the same passes.

        Raises
        ------
        InputError
            If the shape is wrong, a force is not finite or acts at a clamped node, `passes` is
            below 1 or `seed` below 0.
        """
        require_passes(passes, seed)
        nodal = self._checked(forces)
        return self._predicted(nodal, passes, seed)

    @cached_property
    def _one_load(self) -> OneLoad | None:
        """The network in NumPy, for one load; None if it is stochastic or has no such form."""
        if self.is_stochastic or self.network.free.device.type != "cpu":
            return None
        outputs = len(self.network.displacement_scale)
        members = in_numpy(self.network.network, self.geometry.grid.shape, outputs)
        return None if members is None else OneLoad(self.nodal_network, members)

    def _is_one(self, nodal: Array) -> bool:
        return nodal.size == self.geometry.coordinates.size

    def _predicted(self, nodal: Array, passes: int, seed: int) -> Distribution:
        """Predict any number of loads in batches."""
        samples = nodal.reshape(-1, *self.geometry.coordinates.shape)
        passes = passes if self.is_stochastic else 1
        batches = [
            self._distribution(samples[start : start + self._batch], passes, seed)
            for start in range(0, max(len(samples), 1), self._batch)
        ]
        mean, epistemic, aleatoric = (
            np.concatenate(fields).reshape(nodal.shape) for fields in zip(*batches, strict=True)
        )
        return Distribution(mean, epistemic, aleatoric)

    @property
    def _batch(self) -> int:
        values = self.description.run.values_per_point * self.geometry.grid.mask.size
        return max(1, min(BATCH, VALUES // values))

    def _checked(self, forces: ArrayLike) -> Array:
        try:
            nodal = np.asarray(forces, dtype=np.float64)
        except ValueError as error:
            raise InputError(f"forces are no array of numbers ({first_line(error)})") from None
        expected = self.geometry.coordinates.shape
        if nodal.ndim not in (2, 3) or nodal.shape[-2:] != expected:
            raise InputError(f"forces have shape {nodal.shape}, expected {expected} or (N, *)")
        if not np.abs(nodal).max(initial=0.0) < LARGEST_FORCE:  # true for NaN as well
            raise InputError("forces hold a NaN or an infinity, expected finite numbers in N")
        at_held = nodal.reshape(-1, self.geometry.held.size)[:, self._held]
        if at_held.any():
            node = self._held[at_held.any(axis=0)][0] // nodal.shape[-1]
            how = "clamped" if self.geometry.clamped[node] else "held in this component"
            raise InputError(f"forces at node {node}: the node is {how}, expected a free one")
        return nodal

    @torch.inference_mode()
    @convolutions("float32")
    def _distribution(self, nodal: Array, passes: int, seed: int) -> tuple[Array, Array, Array]:
        """Return mean, epistemic and aleatoric standard deviation of one batch, from all passes."""
        force = torch.from_numpy(nodal.astype(np.float32)).to(self.network.free.device)
        at_once = min(self.passes.at_once, max(1, self._batch // max(len(nodal), 1)))
        chunks = [range(t, min(t + at_once, passes)) for t in range(0, passes, at_once)]
        moments = reduce(Moments.joined, (self._moments(force, seed, chunk) for chunk in chunks))
        moments = moments.scaled(self.nodal_network.factors(force)[1].double())
        mean, epistemic, aleatoric = (
            field.cpu().numpy() for field in self.description.run.distribution(moments)
        )
        return mean, epistemic, aleatoric

    def _moments(self, force: Tensor, seed: int, passes: range) -> Moments:
        """Return the moments of some passes in double precision."""
        self.passes.draw(seed, passes)
        mean, std = self.nodal_network(force, len(passes))
        return Moments.of(Prediction(mean.double(), None if std is None else std.double()))

    def require_stochastic(self, **options: int) -> None:
        """Raise InputError if pass options are given for a network that is not stochastic."""
        for name, value in options.items():
            if not self.is_stochastic:
                raise InputError(
                    f"--{name} {value}: passes of this network do not differ, expected one with "
                    "probabilistic weights or dropout"
                )


def require_known_pressure(geometry: Geometry, given: CommandLoads) -> None:
    """Raise InputError if a pressure is given to a network that was trained without any."""
    if given.surfaces and geometry.pressed is None:
        raise InputError("--load: a pressure, expected forces; the network was trained on these")


def require_passes(passes: int, seed: int) -> None:
    """Raise InputError unless number of passes and seed can be meant."""
    for name, value, least, most in (
        ("passes", passes, 1, MOST_PASSES),
        ("seed", seed, 0, MOST_SEED),
    ):
        if not least <= value <= most:
            raise InputError(f"{name} = {value}, expected {least} at least and {most} at most")
