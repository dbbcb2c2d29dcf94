"""A trained network on its body as far as it predicts: displacements and their distributions."""

from __future__ import annotations

import warnings
from functools import cached_property
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
from surrogate.inference.batched_prediction import BatchedPrediction
from surrogate.inference.body import TrainedBody
from surrogate.inference.given_load import checked_loads, separated, without_pressure
from surrogate.inference.training_range import TrainingRange
from surrogate.mechanics.follower_pressure import FollowerPressure
from surrogate.models.series_model import SeriesModel
from surrogate.networks.field_network import FieldNetwork
from surrogate.networks.held_nodes import HeldNodes
from surrogate.networks.no_network import NoNetwork
from surrogate.networks.nodal_network import NodalNetwork
from surrogate.networks.unet import parameter_count
from surrogate.probabilistic.distribution import Distribution
from surrogate.probabilistic.stochastic_passes import PASSES, Passes, require_passes
from surrogate.runs.description import RunDescription
from surrogate.series.body_series import BodySeries
from surrogate.series.series_response import SeriesResponse
from surrogate.time_limit import require_time

if TYPE_CHECKING:
    from surrogate.descent import Aim
    from surrogate.one_load.backend import OneLoad
    from surrogate.one_load.response_alone import ResponseAlone
    from surrogate.one_load.some_nodes import SomeNodes

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
        held = None if geometry.grid.points_are_nodes else HeldNodes(geometry)
        nodal = NodalNetwork(network, geometry.grid, held)
        self.nodal_network = nodal.to(network.free.device)
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
        self.passes = Passes(network)
        self._batched = BatchedPrediction(
            self.nodal_network, self.passes, description.run, geometry.grid.mask.size
        )
        self._some_nodes: SomeNodes | None = None  # of the last prediction at some nodes alone
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
        return self._batched.precision

    @precision.setter
    def precision(self, precision: Precision) -> None:
        self._batched.precision = precision

    @property
    def is_probabilistic(self) -> bool:
        """True if the network predicts standard deviations."""
        return self.is_stochastic or self.description.run.predicts_std

    @property
    def is_stochastic(self) -> bool:
        """True if passes differ from each other."""
        return self.passes.differ

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

        On a CPU, a U-Net or reduced network that is not stochastic predicts one load or a few in
        NumPy (`surrogate.one_load.backend`), a reduced network any number. Its load series is
        compiled by Numba, which takes up to 20 s at the first prediction after an installation.
        The result differs from that of `averaged_passes`, which `solve` uses, and that of a load in
        a large batch from that alone, by rounding in single precision.

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
            Nodes whose displacements are wanted, all by default. A reduced network on a large body
            computes no others.

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
        follows = self._body_series is not None  # without directions as well
        aim = given_aim(tolerance, budget, None if follows else pressure)
        wanted = None if nodes is None else self.geometry.nodes_of(nodes)
        if isinstance(forces, Tensor):
            found = self._predicted_tensor(forces, aim, pressure)
            return found if wanted is None else found[..., torch.from_numpy(wanted), :]
        loads = checked_loads(self.geometry, forces)
        nodal = loads[..., : len(self.geometry.coordinates), :]
        self.training_range.warn(nodal)
        if aim is not None:
            driven = self._driven(loads, aim, pressure)
            return driven if wanted is None else driven[..., wanted, :]
        if wanted is None:
            return self._mean(loads, pressure)
        return self._mean_at(loads, wanted, pressure)

    def _predicted_tensor(
        self, forces: Tensor, aim: Aim | None, pressure: ArrayLike | None
    ) -> Tensor:
        loads = checked_loads(self.geometry, forces)
        nodal = loads[..., : len(self.geometry.coordinates), :]
        self.training_range.warn(nodal)
        kind = forces.dtype if forces.is_floating_point() else torch.float64
        differentiable = forces.requires_grad and torch.is_grad_enabled()
        if aim is not None and differentiable:
            raise InputError(
                "tolerance and budget: directions have no gradients, expected forces without"
            )
        if not differentiable:
            if aim is None:
                found = self._mean(loads, pressure)
            else:
                found = self._driven(loads, aim, pressure)
            return torch.from_numpy(found).to(forces.device, kind)
        samples = forces[..., : nodal.shape[-2], :].reshape(-1, *nodal.shape[-2:])
        mean = self._batched.mean(samples.to(self.network.free.device), PASSES, 0)
        return mean.reshape(nodal.shape).to(forces.device)

    def _mean(self, loads: Array, pressure: ArrayLike | None = None) -> Array:
        """Predict without warnings, at the nodes; a load series looks at all of the loads."""
        nodal = loads[..., : len(self.geometry.coordinates), :]
        if self._body_series is not None:
            return self.responses(*self._told_apart(loads, pressure), nodal)[0]
        return self.mean_and_last_term(nodal)[0]

    def _mean_at(self, loads: Array, nodes: NDArray[np.int64], pressure: ArrayLike | None) -> Array:
        """Predict at some nodes alone: (n, d) or (N, n, d)."""
        from surrogate.one_load.some_nodes import SomeNodes

        nodal = loads[..., : len(self.geometry.coordinates), :]
        one_load, some = self._one_load, self._some_nodes
        if one_load is None or not SomeNodes.fits(one_load):
            return self._mean(loads, pressure)[..., nodes, :]
        if some is None or some.one_load is not one_load or not np.array_equal(some.nodes, nodes):
            some = self._some_nodes = SomeNodes(one_load, nodes)
        found = some(nodal.reshape(-1, *nodal.shape[-2:]))
        return found.reshape(*nodal.shape[:-2], *found.shape[1:])

    def mean_and_last_term(self, nodal: Array) -> tuple[Array, Array]:
        """Predict, and tell what the last term of the load series adds.

        Parameters
        ----------
        nodal : array, (n_nodes, d) or (N, n_nodes, d)
            Checked forces in N.

        Returns
        -------
        array of the same shape
            Displacements in m, as of `predict`.
        array, (N,)
            Largest displacement of the last term in m; infinite unless a series is all there is.
        """
        samples = nodal.reshape(-1, *self.geometry.coordinates.shape)
        last = np.full(len(samples), np.inf)
        if self._response_alone is not None and len(samples):
            mean, last = self._response_alone.several(samples)
        elif self._one_load is not None and len(samples):
            mean = self._one_load.several(samples)
        else:
            mean = self._averaged(nodal, PASSES, 0).mean
        return mean.reshape(nodal.shape), last

    @cached_property
    def _body_series(self) -> BodySeries | None:
        """The load series of bodies of other materials, elements and loads than `SeriesResponse`.

        None if that has the body's, a network adds to the response, or the run's is the linear one.
        """
        run, linear = self.description.run, self.network.linear
        if not isinstance(run, SeriesModel) or run.series_order == 1:
            return None
        one_of_its = isinstance(linear, SeriesResponse) and not self.geometry.has_points_between
        if one_of_its and self.geometry.pressed is None:
            return None
        try:
            return BodySeries(self.equilibrium, run.series_order)
        except InputError:  # elements or a material that are not known here
            return None

    def responses(
        self, dead: Array, pressure: FollowerPressure | None, nodal: Array
    ) -> tuple[Array, Array]:
        """Predict, and tell what the last term of the load series adds, under given loads.

        Parameters
        ----------
        dead : array, (n_nodes or n_points, d) or with N before
            Dead loads in N.
        pressure : FollowerPressure or None
            Pressures of the load cases that follow the surface.
        nodal : array, (n_nodes, d) or (N, n_nodes, d)
            Nodal forces in N, with those of pressures on the undeformed body.

        Returns
        -------
        tuple of array
            As of `mean_and_last_term`.
        """
        series = self._body_series
        if series is None:
            return self.mean_and_last_term(nodal)
        forces = self.equilibrium.forces_at_points(dead.reshape(-1, *dead.shape[-2:]))
        found, last = series(forces, pressure)
        return found[:, : nodal.shape[-2]].reshape(nodal.shape), last

    def _told_apart(
        self, loads: Array, pressure: ArrayLike | None
    ) -> tuple[Array, FollowerPressure | None]:
        """Dead loads, and pressures that are given or, if they can be, told from the loads."""
        if pressure is not None or not self.geometry.surfaces:
            return without_pressure(self.geometry, loads, pressure)
        dead, follows = separated(self.geometry, loads.reshape(-1, *loads.shape[-2:]))
        return dead.reshape(loads.shape), follows

    def _driven(self, loads: Array, aim: Aim, pressure: ArrayLike | None) -> Array:
        """Predict, and drive load by load towards the equilibrium."""
        from surrogate.descent.aim import UnreachedToleranceWarning

        dead, follows = without_pressure(self.geometry, loads, pressure)
        nodal, driven, missed = loads[..., : len(self.geometry.coordinates), :], [], []
        mean, last = self.responses(dead, follows, nodal)
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

    @cached_property
    def _response_alone(self) -> ResponseAlone | None:
        """The response of the body on the CPU; None if a network adds to it."""
        alone = isinstance(self.network.network, NoNetwork)
        if not alone or self.network.free.device.type != "cpu":
            return None
        from surrogate.one_load.response_alone import ResponseAlone

        return ResponseAlone(self.nodal_network)

    @property
    def is_response_alone(self) -> bool:
        """Whether the prediction is the response of the body, to which no network adds."""
        return self._body_series is not None or self._response_alone is not None

    @cached_property
    def _one_load(self) -> OneLoad | None:
        """The network in NumPy, for one load; None if it is stochastic or has no such form."""
        if self.is_stochastic or self.network.free.device.type != "cpu":
            return None
        from surrogate.one_load.backend import OneLoad, in_numpy

        outputs = len(self.network.displacement_scale)
        members = in_numpy(self.network.network, self.geometry.grid.shape, outputs)
        return None if members is None else OneLoad(self.nodal_network, members)

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
        return self._averaged(checked_loads(self.geometry, forces), passes, seed)

    def _averaged(self, loads: Array, passes: int, seed: int) -> Distribution:
        nodal = loads[..., : len(self.geometry.coordinates), :]
        samples = nodal.reshape(-1, *self.geometry.coordinates.shape)
        if self._body_series is not None:
            mean, _ = self.responses(*self._told_apart(loads, None), nodal)
            return Distribution(mean, np.zeros_like(mean), np.zeros_like(mean))
        return self._batched.distribution(samples, passes, seed).reshaped(nodal.shape)

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
