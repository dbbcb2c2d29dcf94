"""A trained network on its body as far as it predicts: displacements and their distributions."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, overload

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from shared_schema.common.arguments.checked_arguments import checked_arguments
from shared_schema.common.errors import InputError
from surrogate.data.geometry import SURFACE, Geometry
from surrogate.data.load_range import PressedNodes, known_families
from surrogate.device import Precision
from surrogate.inference.body import TrainedBody
from surrogate.inference.given_load import checked_loads, without_pressure
from surrogate.inference.prediction import Predictor
from surrogate.inference.training_range import TrainingRange
from surrogate.networks.field_network import FieldNetwork
from surrogate.networks.unet import parameter_count
from surrogate.probabilistic.distribution import Distribution
from surrogate.probabilistic.stochastic_passes import PASSES, require_passes
from surrogate.runs.description import RunDescription
from surrogate.series.series_response import SeriesResponse
from surrogate.time_limit import require_time

if TYPE_CHECKING:
    from surrogate.descent import Aim

Array = NDArray[np.float64]


class TrainedNetwork(TrainedBody):
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
    folder : Path or None
        Run folder that the network was loaded from.
    mean_error : float or None
        ē on the test split of its training's dataset, in m; None if the run is not evaluated.
    """

    def __init__(
        self, network: FieldNetwork, geometry: Geometry, description: RunDescription
    ) -> None:
        super().__init__(network.eval(), geometry, description)
        self.predictor = Predictor(self)
        self.nodal_network, self.passes = self.predictor.network, self.predictor.passes
        data = description.data
        self.training_range = TrainingRange.none(geometry)
        if description.run.learns:
            self.training_range = TrainingRange(
                data.info.force.max_abs,
                geometry.loadable,
                data.loads,
                geometry.grid,
                PressedNodes.of(geometry, data.case),
                known_families(data.case),
                data.units,
            )
        self.folder: Path | None = None
        self.mean_error: float | None = None

    def __repr__(self) -> str:
        """Say what it is, such as "Surrogate(beam2d, 64 nodes, U-Net 0.47 M, ē 0.06 mm)"."""
        run = self.description.run
        size = run.title
        if count := parameter_count(self.network):
            size += f" {count / 1e6:.2f} M"
        parts = [run.case, f"{len(self.geometry.coordinates)} nodes", size]
        if run.likelihood != "deterministic":
            parts.append(run.likelihood.replace("_", " "))
        if self.mean_error is not None:
            parts.append(f"ē {self.description.data.units.written(self.mean_error)}")
        return f"Surrogate({', '.join(parts)})"

    @property
    def precision(self) -> Precision:
        """Precision of the network's convolutions on a GPU."""
        return self.predictor.batched.precision

    @precision.setter
    def precision(self, precision: Precision) -> None:
        self.predictor.batched.precision = precision

    @property
    def has_series(self) -> bool:
        """Whether the response of the body is a load series, beyond the linear one."""
        within = isinstance(self.network.linear, SeriesResponse)
        return within or self.predictor.series is not None

    @property
    def is_probabilistic(self) -> bool:
        """True if the network predicts standard deviations."""
        return self.predictor.is_probabilistic

    @property
    def is_stochastic(self) -> bool:
        """True if passes differ from each other."""
        return self.predictor.is_stochastic

    @overload
    def predict(
        self,
        forces: Tensor,
        *,
        tolerance: float | None = None,
        budget: float | None = None,
        pressure: ArrayLike | None = None,
        nodes: str | ArrayLike | None = None,
    ) -> Tensor: ...
    @overload
    def predict(
        self,
        forces: ArrayLike,
        *,
        tolerance: float | None = None,
        budget: float | None = None,
        pressure: ArrayLike | None = None,
        nodes: str | ArrayLike | None = None,
    ) -> Array: ...
    def predict(
        self,
        forces: ArrayLike | Tensor,
        *,
        tolerance: float | None = None,
        budget: float | None = None,
        pressure: ArrayLike | None = None,
        nodes: str | ArrayLike | None = None,
    ) -> Array | Tensor:
        """Predict displacements, the means of `predict_distribution`.

        Compiled code of Numba computes a load series on a CPU, which takes up to 20 s at the first
        prediction after an installation. A load of a large batch differs from that load alone by
        rounding in single precision.

        With a tolerance or a budget, directions drive every prediction towards the equilibrium of
        the finite elements until its estimated error is small enough (`surrogate.descent`); a good
        one takes a single direction, and none where the last term of its load series is small.

        Issues an `OutsideTrainingWarning`, once a kind, for forces unlike those of the training,
        and an `UnreachedToleranceWarning` if directions end before the tolerance is reached. What
        is then returned is the best displacement that was met.

        Parameters
        ----------
        forces : array or Tensor, (n_nodes, d) or (N, n_nodes, d)
            Nodal forces in N, or loads as those of `Surrogate.certify`. A tensor that requires
            gradients gives displacements that are differentiable by the forces; the network's
            weights get no gradients.
        tolerance : float, optional
            Largest error of a node, relative to the largest displacement under the load.
        budget : float, optional
            Seconds that the directions of each load may take, after its prediction.
        pressure : array, (n_surfaces,) or (N, n_surfaces)
            As that of `Surrogate.certify`, beside a tolerance or a budget, or of a load series that
            follows the surface; by default the pressures that the forces tell.
        nodes : "surface", name of a group of nodes, or array of int, optional
            Nodes whose displacements are wanted, all by default.

        Returns
        -------
        array, or Tensor if the forces are one, of the same shape, or with n `nodes` of n_nodes
            Nodal displacements in m; those of a tensor have its precision and device.

        Raises
        ------
        InputError
            If the shape is wrong, a force is not finite, or one acts at a clamped node; there are
            no such nodes; or a tolerance or budget is not positive, stands beside gradients, or is
            for a body whose equilibrium the learner does not compute.
        """
        require_time()
        follows = self.predictor.series is not None  # without directions as well
        aim = given_aim(tolerance, budget, None if follows else pressure)
        wanted = None if nodes is None else self.geometry.nodes_of(nodes)
        loads = checked_loads(self.geometry, forces)
        self.training_range.warn(loads[..., : len(self.geometry.coordinates), :])
        found: Array | Tensor
        if isinstance(forces, Tensor) and forces.requires_grad and torch.is_grad_enabled():
            if aim is not None:
                raise InputError(
                    "tolerance and budget: directions have no gradients, expected forces without"
                )
            found = self.predictor.differentiable(forces)
        else:
            if aim is None:
                found, _ = self.predictor.respond(loads, pressure)
            else:
                found = self._driven(loads, aim, pressure)
            if isinstance(forces, Tensor):
                kind = forces.dtype if forces.is_floating_point() else torch.float64
                found = torch.from_numpy(found).to(forces.device, kind)
        return found if wanted is None else found[..., wanted, :]

    def _driven(self, loads: Array, aim: Aim, pressure: ArrayLike | None) -> Array:
        """Predict, and drive load by load towards the equilibrium."""
        from surrogate.descent.aim import UnreachedToleranceWarning

        dead, follows = without_pressure(self.geometry, loads, pressure)
        nodal, driven, missed = loads[..., : len(self.geometry.coordinates), :], [], []
        mean, last = self.predictor.under(dead, follows, loads)
        each = (fields.reshape(-1, *fields.shape[-2:]) for fields in (dead, mean))
        for number, (force, predicted, remainder) in enumerate(zip(*each, last, strict=True)):
            one = None if follows is None else follows[slice(number, number + 1)]
            displacement, descent = self.descend(force, one, predicted, aim, float(remainder))
            driven.append(displacement)
            if descent.reached is False:
                missed.append(f"load {number}: {descent.refusal(self.description.data.units)}")
        if missed:
            others = f", and {len(missed) - 1} other loads" if len(missed) > 1 else ""
            warnings.warn(missed[0] + others, UnreachedToleranceWarning, stacklevel=3)
        return np.array(driven).reshape(nodal.shape)

    @checked_arguments
    def predict_distribution(
        self, forces: ArrayLike | Tensor, passes: int = PASSES, seed: int = 0
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
            If the network predicts no standard deviations, the shape is wrong, a force is not
            finite or acts at a clamped node, `passes` is below 1 or `seed` below 0.
        """
        if not self.is_probabilistic:
            raise InputError(
                f"likelihood '{self.description.run.likelihood}': the network predicts no standard "
                "deviations, expected Surrogate.predict, or solve with certify='fast' or 'full'"
            )
        return self.averaged_passes(forces, passes, seed)

    def averaged_passes(
        self, forces: ArrayLike | Tensor, passes: int = PASSES, seed: int = 0
    ) -> Distribution:
        """Do what `predict_distribution` does, of any network: σ is 0 if it predicts none."""
        require_passes(passes, seed)
        return self.predictor.distribution(checked_loads(self.geometry, forces), passes, seed)

    def prepare(self, nodes: str | ArrayLike = SURFACE) -> None:
        """Get ready for loads on some nodes of a large body, such as those that a tool reaches.

        Predictions that begin with the linear response solve with the stiffness of the body, unless
        a load acts on a few nodes, or is a uniform body force. With the columns of its inverse for
        these nodes, loads on any number of them, beside a body force, cost a sum. They are solved
        for once, kept while the model lives, and written beside its run
        (``columns.safetensors``), unless that comes with the package. A body that keeps the whole
        inverse (up to 4000 degrees of freedom) is ready as it is.

        Parameters
        ----------
        nodes : "surface", name of a group of nodes, or array of int

        Raises
        ------
        InputError
            If there is no such group or node, the columns take more than 2 GiB, the network does
            not begin with the response of the body at its own nodes, or another process works in
            the run folder.
        """
        from surrogate.inference.touched_region import keep_columns

        keep_columns(self, nodes)

    def require_stochastic(self, **options: int | None) -> None:
        """Raise InputError if pass options are given for a network that is not stochastic."""
        for name, value in options.items():
            if value is not None and not self.is_stochastic:
                raise InputError(
                    f"--{name} {value}: passes of this network do not differ, expected one with "
                    "probabilistic weights or dropout"
                )


def given_aim(
    tolerance: float | None, budget: float | None, pressure: ArrayLike | None
) -> Aim | None:
    """Return what directions aim at; None if there are to be none. InputError if it is wrong."""
    if tolerance is None and budget is None:
        if pressure is not None:
            raise InputError("pressure: expected beside a tolerance or a budget")
        return None
    from surrogate.descent.aim import Aim

    return Aim(tolerance, budget)
