"""The prediction of a trained network or load series, one for arrays, tensors and distributions."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from shared_schema.common.errors import InputError
from surrogate.learning.data.load_range import only_follows
from surrogate.learning.models.batched_prediction import BatchedPrediction
from surrogate.learning.models.kinds import RunConfig
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.networks.nodal_network import HeldNodes, NodalNetwork
from surrogate.learning.probabilistic.distribution import Distribution
from surrogate.learning.probabilistic.stochastic_passes import PASSES, Passes
from surrogate.mechanics.descent.aim import Aim
from surrogate.mechanics.series.series_response import SeriesResponse
from surrogate.mechanics.statics.body import Body, Remade
from surrogate.mechanics.statics.load import Load
from surrogate.mechanics.statics.prediction import Series

if TYPE_CHECKING:
    from surrogate.learning.networks.reduced_at_nodes import ReducedAtNodes

Array = NDArray[np.float64]


class Predictor(Remade):
    """Loads of a body to displacements at its nodes.

    Parameters
    ----------
    network : FieldNetwork
        In evaluation.
    body : Body
    run : RunConfig

    Attributes
    ----------
    network : NodalNetwork
    passes : Passes
    batched : BatchedPrediction
        The network in PyTorch, on any device: what is not a load series, nor a reduced network on
        the CPU that predicts no standard deviations.
    """

    def __init__(self, network: FieldNetwork, body: Body, run: RunConfig) -> None:
        self.body, self._run, self._linear = body, run, network.linear
        geometry = body.geometry
        self._nodes, self._device = len(geometry.coordinates), network.free.device
        held = None if geometry.grid.points_are_nodes else HeldNodes(geometry)
        nodal = NodalNetwork(network, geometry.grid, held)
        self.network, self.passes = nodal.to(self._device), Passes(network)
        points = geometry.grid.mask.size
        self.batched = BatchedPrediction(self.network, self.passes, run, points)

    @cached_property
    def series(self) -> Series | None:
        """The load series of the body at all of its points; None if the run's is not one."""
        run, linear = self._run, self._linear
        if run.learns or not isinstance(linear, SeriesResponse):
            return None
        return Series(self.body, terms=linear.series)

    @property
    def has_series(self) -> bool:
        """Whether the response of the body is a load series, beyond the linear one."""
        return isinstance(self._linear, SeriesResponse)

    @property
    def knows_forces(self) -> bool:
        """Whether it predicts other forces than pressures and those of actuators."""
        return not (self._run.learns and only_follows(self.body.case))

    @cached_property
    def at_nodes(self) -> ReducedAtNodes | None:
        """A reduced network on the CPU that is not stochastic, or None."""
        if self.passes.differ or self._run.model != "reduced":
            return None
        from surrogate.learning.networks.reduced_at_nodes import ReducedAtNodes

        return ReducedAtNodes(self.network) if ReducedAtNodes.fits(self.network) else None

    def respond(
        self, loads: Load | Array, pressure: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Predict, and tell what the last term of a load series adds.

        Parameters
        ----------
        loads : Load, or array (n_nodes or n_points, d) or with N before
            Checked loads in N; as an array, those of `Surrogate.certify`.
        pressure : array, (n_surfaces,) or (N, n_surfaces), optional
            As that of `Surrogate.certify`, of an array; by default, the pressures that the forces
            tell. Matters to a load series alone.

        Returns
        -------
        array, (n_nodes, d) or with N before
            Displacements in m.
        array, (N,)
            Largest displacement of the last term in m; infinite unless a series is all there is.
        """
        if self.series is not None:
            load = loads if isinstance(loads, Load) else self._told_apart(loads, pressure)
            return self.series.respond(load)
        forces = loads.at_rest(self.body.geometry) if isinstance(loads, Load) else loads
        nodal = forces[..., : self._nodes, :]
        samples = nodal.reshape(-1, *nodal.shape[-2:])
        if not len(samples):
            found = samples
        elif self.at_nodes is not None:
            found = self.at_nodes(samples)
        else:
            found = self.batched.distribution(samples, PASSES, 0).mean
        return found.reshape(nodal.shape), np.full(len(samples), np.inf)

    def distribution(self, loads: Array, passes: int, seed: int) -> Distribution:
        """Predict means and standard deviations in m of checked loads; σ is 0 if there is none."""
        if not self.is_probabilistic and (self.series is not None or self.at_nodes is not None):
            return certain(self.respond(loads)[0])
        nodal = loads[..., : self._nodes, :]
        samples = nodal.reshape(-1, *nodal.shape[-2:])
        return self.batched.distribution(samples, passes, seed).reshaped(nodal.shape)

    def differentiable(self, forces: Tensor) -> Tensor:
        """Predict means in m of checked loads, which require gradients, of their precision."""
        nodal = forces[..., : self._nodes, :]
        samples = nodal.reshape(-1, *nodal.shape[-2:]).to(self._device)
        return self.batched.mean(samples, PASSES, 0).reshape(nodal.shape).to(forces.device)

    @property
    def is_stochastic(self) -> bool:
        """True if passes differ from each other."""
        return self.passes.differ

    @property
    def is_probabilistic(self) -> bool:
        """True if the network predicts standard deviations."""
        return self.is_stochastic or self._run.predicts_std

    def _told_apart(self, loads: Array, pressure: ArrayLike | None) -> Load:
        """Dead loads, and pressures that are given or, if they can be, told from the loads."""
        geometry = self.body.geometry
        if pressure is not None or not geometry.following:
            return Load.told_apart(geometry, loads, pressure)
        of_samples = Load.of_samples(geometry, loads.reshape(-1, *loads.shape[-2:]))
        return replace(of_samples, dead=of_samples.dead.reshape(loads.shape))


def certain(mean: Array) -> Distribution:
    """Means without standard deviations."""
    return Distribution(mean, np.zeros_like(mean), np.zeros_like(mean))


def given_aim(
    tolerance: float | None, budget: float | None, pressure: ArrayLike | None
) -> Aim | None:
    """Return what directions aim at; None if there are to be none. InputError if it is wrong."""
    if tolerance is None and budget is None:
        if pressure is not None:
            raise InputError("pressure: expected beside a tolerance or a budget")
        return None
    return Aim(tolerance, budget)
