"""A body with what predicts it: predictions, solutions, certificates, corrections and stresses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, overload

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from shared_schema.common.arguments import checked_arguments, real_numbers
from shared_schema.common.errors import InputError, WorkError
from shared_schema.common.progress import Progress
from surrogate.learning.inference.prediction import Predictor, given_aim
from surrogate.learning.inference.training_range import TrainingRange
from surrogate.learning.networks.field_network import FieldNetwork, parameter_count
from surrogate.learning.probabilistic.distribution import Distribution
from surrogate.learning.probabilistic.stochastic_passes import PASSES, require_passes
from surrogate.learning.runs.description import RunDescription
from surrogate.learning.runs.folder import RunFolder
from surrogate.mechanics.body.elements_of_case import with_elements
from surrogate.mechanics.body.geometry import PREFIX, SURFACE, Geometry
from surrogate.mechanics.body.stiffness import case_of_moduli
from surrogate.mechanics.certify.certificate_protocol import LEVEL
from surrogate.mechanics.equilibrium.compliance import Compliance
from surrogate.mechanics.statics.body import Body, Remade
from surrogate.mechanics.statics.load import GivenLoad, Load, checked_load, checked_loads
from surrogate.mechanics.statics.prediction import driven
from surrogate.runtime.device import Precision
from surrogate.runtime.time_limit import require_time

if TYPE_CHECKING:
    from shared_schema.tools import Tool
    from surrogate.learning.inference.solution import Solution
    from surrogate.mechanics.actuation.actuation import Actuation
    from surrogate.mechanics.certify import (
        Bounds,
        Certificate,
        Correction,
        FastCertificate,
        FastEstimate,
        Intervals,
    )
    from surrogate.mechanics.touch.grip import Held

Array = NDArray[np.float64]
SHAPES = 8  # that are kept


class Surrogate(Remade):
    """A body, and what predicts its displacements: a trained network, or a load series.

    Parameters
    ----------
    network : FieldNetwork
    geometry : Geometry
        Mesh, supports and grid; its node numbers are those of forces and displacements.
    description : RunDescription
        Configuration and dataset of the run.

    Attributes
    ----------
    body : Body
        Its equilibria, stresses and reactions.
    predictor : Predictor
        Loads to displacements.
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
        self.network, self.geometry, self.description = network.eval(), geometry, description
        shared = [each for each in network.modules() if isinstance(each, Compliance)]
        self.body = Body(geometry, description.data.case, shared, network.free.device)
        self.predictor = Predictor(network, self.body, description.run)
        self.training_range = TrainingRange.of(geometry, description)
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
        return self.predictor.has_series

    @cached_property
    def actuation(self) -> Actuation:
        """The actuators of the body in its modes, which ``surrogate actuate`` keeps in the folder.

        Raises
        ------
        InputError
            If there are none.
        """
        from surrogate.mechanics.actuation.actuation import KEPT, Actuation

        if self.geometry.parameters is not None:
            raise InputError("actuators: of another shape, expected the body of the run")
        path = self.run.folder / KEPT
        if not path.is_file():
            raise InputError(f"{path}: expected the modes that 'surrogate actuate' keeps there")
        return Actuation.read(path, self.body)

    @property
    def knows_forces(self) -> bool:
        """Whether it predicts other forces than pressures and those of actuators."""
        return self.predictor.knows_forces

    def respond(self, loads: Load) -> tuple[Array, Array]:
        """Predict checked loads, as `Predictor.respond`; warns as `predict`."""
        require_time()
        self.training_range.warn(loads.at_rest(self.geometry))
        return self.predictor.respond(loads)

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
        parameters: Mapping[str, float] | None = None,
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
        parameters: Mapping[str, float] | None = None,
    ) -> Array: ...
    def predict(
        self,
        forces: ArrayLike | Tensor,
        *,
        tolerance: float | None = None,
        budget: float | None = None,
        pressure: ArrayLike | None = None,
        nodes: str | ArrayLike | None = None,
        parameters: Mapping[str, float] | None = None,
    ) -> Array | Tensor:
        """Predict displacements, the means of `predict_distribution`.

        Compiled code of Numba computes a load series on a CPU, which takes up to 20 s at the first
        prediction after an installation. A load of a large batch differs from that load alone by
        rounding in single precision.

        With a tolerance or a budget, directions drive every prediction towards the equilibrium of
        the finite elements until its estimated error is small enough
        (`surrogate.mechanics.descent`); a good one takes a single direction, and none where the
        last term of its load series is small.

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
        parameters : mapping of str to float, optional
            Those of the body's shape, as of `of_shape`.

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
        model = self.of_shape(parameters) if parameters else self
        follows = model.predictor.series is not None  # without directions as well
        aim = given_aim(tolerance, budget, None if follows else pressure)
        wanted = None if nodes is None else model.geometry.nodes_of(nodes)
        loads = checked_loads(model.geometry, forces)
        model.training_range.warn(loads[..., : len(model.geometry.coordinates), :])
        found: Array | Tensor
        if isinstance(forces, Tensor) and forces.requires_grad and torch.is_grad_enabled():
            if aim is not None:
                raise InputError(
                    "tolerance and budget: directions have no gradients, expected forces without"
                )
            found = model.predictor.differentiable(forces)
        else:
            if aim is None:
                found, _ = model.predictor.respond(loads, pressure)
            else:
                found = driven(
                    model.predictor, Load.told_apart(model.geometry, loads, pressure), aim
                )
            if isinstance(forces, Tensor):
                kind = forces.dtype if forces.is_floating_point() else torch.float64
                found = torch.from_numpy(found).to(forces.device, kind)
        return found if wanted is None else found[..., wanted, :]

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

    def passes_in_shapes(
        self, forces: Array, shapes: Array | None, passes: int = PASSES, seed: int = 0
    ) -> Distribution:
        """Do the same, each load on a shape of its own, by its parameters: (N, n_parameters)."""
        if shapes is None or self.geometry.shapes is None:
            return self.averaged_passes(forces, passes, seed)
        parts, names = [], self.geometry.shapes.names
        for row, values in enumerate(shapes.tolist()):
            shape = self.of_shape(dict(zip(names, values, strict=True)))
            parts.append(shape.averaged_passes(forces[row : row + 1], passes, seed))
        return Distribution.joined(parts)

    @checked_arguments
    def solve(
        self,
        load: GivenLoad = (),
        *,
        held: Held | None = None,
        tool: str | Tool | None = None,
        body_force: str | Sequence[float] | None = None,
        young_modulus: float | None = None,
        certify: Literal["fast", "full"] | None = None,
        correct: bool = False,
        tolerance: float | None = None,
        budget: float | None = None,
        level: float | None = None,
        conformal: Literal["marginal", "simultaneous"] | None = None,
        stresses: bool = False,
        nearest: bool = False,
        passes: int | None = None,
        seed: int | None = None,
        parameters: Mapping[str, float] | None = None,
    ) -> Solution:
        """Predict one load case; certify or correct it.

        Parameters
        ----------
        load : array (n_nodes or n_points, d), Tensor, str, Path or sequence of str and Path
            Nodal forces in N, and after these, of elements with points between the nodes, the
            forces there (`Solution.load`); or texts such as "4,1:0,-1.5" (a force in N at the node
            there), "top:0,-2" (on a group of the mesh) or "top:5" (a pressure in Pa), and files of
            forces. All act together.
        held : mapping of str to displacements, or sequence of str, optional
            Places and groups that are held at displacements in m, such as {"4,1": (0.02, None)},
            or texts such as "4,1:0.02,-"; the solution's `force` holds the forces that do it
            (`surrogate.Grip`).
        tool : Tool or str, optional
            A rigid tool of `shared_schema.tools` that the surface keeps out of, without friction,
            or a text such as "sphere:3,1.2:0.3"; the solution's `force` holds its forces, and
            `contact` says more (`surrogate.Touch`).
        body_force : str or sequence of d floats, optional
            A force in N per m³ of the undeformed body that acts everywhere, such as its weight.
        young_modulus : float, optional
            Young's modulus at rest in Pa, of a body of one material: by default that of the run
            (`surrogate.mechanics.body.stiffness`).
        certify : {"full", "fast"}, optional
            Estimate the error: by Newton steps; or in real time, with bounds that hold with some
            probability, which `surrogate evaluate --certify` calibrates. A load or state unlike
            those of this calibration has no bound, and is not certified. Intervals of single
            components, of networks that predict standard deviations, are there without `certify`.
        correct : bool
            Go on from the prediction to the equilibrium of the finite elements. A certificate is
            then that of this equilibrium, as it is of what the solution shows in any case.
        tolerance : float, optional
            Largest error of a node: in m with `certify`, which tells whether it is kept, else
            relative to the largest displacement. Unless the prediction is corrected, directions
            drive it towards the equilibrium until its estimated error is small enough
            (`surrogate.mechanics.descent`).
        budget : float, optional
            Seconds that directions may take, whether or not there is a tolerance.
        level : float, optional
            Probability of each fast bound; 0.95 by default.
        conformal : {"marginal", "simultaneous"}, optional
            Add the bounds of the run's conformal intervals.
        stresses : bool
            Compute stresses of the cells and reactions of the supports.
        nearest : bool
            Let forces at other places act at the nearest node; the solution's notes say which.
        passes, seed : int, optional
            Number of passes of a stochastic network and their seed; 300 and 0 by default.
        parameters : mapping of str to float, optional
            Those of the body's shape, as of `of_shape`.

        Raises
        ------
        InputError
            If the load is wrong, an option needs another one, or the run lacks what it needs.
        WorkError
            If no equilibrium is found.
        """
        from surrogate.learning.inference.solving import Wanted, solved

        wanted = Wanted(
            held=held,
            tool=tool,
            body_force=body_force,
            young_modulus=young_modulus,
            certify=certify,
            correct=correct,
            tolerance=tolerance,
            budget=budget,
            level=level,
            conformal=conformal,
            stresses=stresses,
            nearest=nearest,
            passes=passes,
            seed=seed,
        )
        return solved(self.of_shape(parameters) if parameters else self, load, wanted)

    # --- certificates and corrections -------------------------------------------------------------

    def certify(
        self,
        forces: ArrayLike,
        predicted: ArrayLike | None = None,
        *,
        pressure: ArrayLike | None = None,
    ) -> Certificate:
        """Estimate the errors of predictions from their out-of-balance forces.

        Parameters
        ----------
        forces : array, (n_nodes, d) or (N, n_nodes, d)
            Nodal forces in N, with those that pressures have on the undeformed body, as in a
            dataset. On elements with points between the nodes the forces there may follow, so that
            there are n_points rows; without them, these are the pressures' alone.
        predicted : array of the same shape, optional
            Displacements in m; by default those of `predict`.
        pressure : array, (n_surfaces,) or (N, n_surfaces)
            Pressures in Pa on the surfaces of the case, which follow the deformed body: expected if
            and only if the case has such surfaces; 0 if forces act alone.

        Raises
        ------
        InputError
            If a shape is wrong, a force is not finite, or the run does not name its material.
        """
        loads = checked_loads(self.geometry, forces)
        return self.body.certify(*self._checked(loads, predicted, pressure))

    def bounds(
        self,
        forces: ArrayLike,
        predicted: ArrayLike | None = None,
        level: float = LEVEL,
        *,
        pressure: ArrayLike | None = None,
    ) -> Bounds:
        """Bound the errors of predictions in real time, by the run's fast certificate.

        Parameters
        ----------
        forces : array, (n_nodes, d) or (N, n_nodes, d)
            Nodal forces in N, as those of `certify`.
        predicted : array of the same shape, optional
            Displacements in m; by default the network's, whose standard deviations give the
            intervals of single components.
        level : float
            Probability of each bound.
        pressure : array, (n_surfaces,) or (N, n_surfaces)
            As that of `certify`.

        Returns
        -------
        Bounds
            Infinite, with the reason, for loads and states unlike those of the calibration.

        Raises
        ------
        InputError
            If a shape is wrong, a force is not finite, or the run has no fast certificate or none
            of this level.
        """
        fast, loads, std = self.fast_of_level(level), checked_loads(self.geometry, forces), None
        if predicted is None and self.is_probabilistic:
            network = self.predictor.distribution(loads, PASSES, 0)
            predicted, std = network.mean, network.std
        load, displacement = self._checked(loads, predicted, pressure)
        return fast.certify(load.dead, displacement, level, std, load.following)

    def correct(
        self,
        forces: ArrayLike,
        predicted: ArrayLike | None = None,
        *,
        pressure: ArrayLike | None = None,
    ) -> Correction:
        """Go on from a prediction to the finite elements' equilibrium.

        Parameters
        ----------
        forces : array, (n_nodes or n_points, d)
            A load in N, as those of `certify`.
        predicted : array of the same shape, optional
            Displacements in m, which may be wrong; by default those of `predict`.
        pressure : array, (n_surfaces,)
            As that of `certify`.

        Raises
        ------
        InputError
            As `certify`.
        WorkError
            If no equilibrium is found.
        """
        load = checked_load(self.geometry, forces)
        return self.body.correct(*self._checked(load, predicted, pressure))

    def correct_each(
        self,
        forces: ArrayLike,
        predicted: ArrayLike | None = None,
        *,
        pressure: ArrayLike | None = None,
    ) -> list[Correction]:
        """Go on from many predictions to their equilibria, one after the other.

        Parameters
        ----------
        forces, predicted : array, (N, n_nodes, d)
            As in `correct`.
        pressure : array, (n_surfaces,) or (N, n_surfaces)
            As that of `certify`.

        Raises
        ------
        InputError
            As `certify`.
        WorkError
            If no equilibrium is found for a load; the message has its number.
        """
        shape = self.geometry.coordinates.shape
        loads = checked_loads(self.geometry, forces)
        if loads.ndim != 3:
            raise InputError(f"forces have shape {loads.shape}, expected {('N', *shape)}")
        each, displacement = self._checked(loads, predicted, pressure)
        found = []
        progress = Progress(len(loads), unit="loads", title="surrogate: corrections", passing=True)
        with closing(progress):
            for number in range(len(loads)):
                try:
                    found.append(self.body.correct(each[number], displacement[number]))
                except WorkError as error:
                    raise WorkError(f"load {number}: {error}") from None
                progress.update(number + 1)
        return found

    def _checked(
        self, loads: Array, predicted: ArrayLike | None, pressure: ArrayLike | None
    ) -> tuple[Load, Array]:
        """Return checked loads, and given displacements; predict them if they are not given."""
        load = Load.told_apart(self.geometry, loads, pressure)
        nodal = loads[..., : len(self.geometry.coordinates), :]
        if predicted is None:
            return load, self.predictor.respond(loads)[0]
        displacement = real_numbers(predicted, "predicted displacements")
        if displacement.shape != nodal.shape:
            raise InputError(f"predicted has shape {displacement.shape}, expected {nodal.shape}")
        return load, displacement

    # --- stresses ---------------------------------------------------------------------------------

    def stresses(
        self,
        displacement: ArrayLike | Tensor,
        forces: ArrayLike | Tensor | None = None,
        *,
        pressure: ArrayLike | None = None,
    ) -> dict[str, Array]:
        """Compute stresses at the middle of every cell, as `Body.stresses`."""
        return self.body.stresses(displacement, forces, pressure=pressure)

    def reactions(
        self,
        displacement: ArrayLike | Tensor,
        pushed: ArrayLike | Tensor | None = None,
        *,
        forces: ArrayLike | Tensor | None = None,
    ) -> Array:
        """Compute the forces of the supports on the body in N, as `Body.reactions`."""
        return self.body.reactions(displacement, pushed, forces=forces)

    # --- the run ----------------------------------------------------------------------------------

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
        from surrogate.learning.inference.touched_region import keep_columns

        keep_columns(self, nodes)

    def with_young_moduli(self, moduli: Mapping[str, float]) -> Surrogate:
        """Make the same load series for a body whose zones have other Young's moduli.

        The stiffness of the body at rest is factorised anew; all that is computed from the body is
        that of the new one, and its fast bounds would have to be calibrated again.

        Parameters
        ----------
        moduli : mapping of str to float
            Young's modulus at rest in Pa by group of the case's materials; others stay.

        Raises
        ------
        InputError
            If the model has learned from samples, the body is of one material, there is no such
            group, or a modulus is not positive and finite.
        """
        run, data = self.description.run, self.description.data
        if run.learns:
            raise InputError(
                f"young_modulus: '{run.name}' has learned from samples of other moduli, expected a "
                "load series ('surrogate train series')"
            )
        case = case_of_moduli(data.case, data.material, moduli)
        changed = {"data": data.model_copy(update={"case": case})}
        tensors = {**self.network.state_dict(), **self.geometry.tensors()}
        description = self.description.model_copy(update=changed)
        return make_surrogate(tensors, description, self.network.free.device.type)

    def of_shape(self, parameters: Mapping[str, float]) -> Surrogate:
        """Make the same model for the body in the shape of some parameters.

        The stiffness of the shape is factorised; certificates, corrections and stresses are those
        of its own finite elements. The last few shapes are kept.

        Parameters
        ----------
        parameters : mapping of str to float
            By their names; the others are in the middle of their ranges. Predictions of a trained
            network warn of those outside.

        Raises
        ------
        InputError
            If the body has one shape, there is no such parameter, or they tangle the mesh.
        """
        geometry = self.geometry.of_shape(parameters)
        assert geometry.parameters is not None
        key = geometry.parameters.tobytes()
        if key not in self._shapes:
            tensors = {**self.network.state_dict(), **geometry.tensors()}
            device = self.network.free.device.type
            made = make_surrogate(tensors, self.description, device)
            made.mean_error, made.precision = self.mean_error, self.precision
            made.folder = self.folder
            for oldest in list(self._shapes)[: len(self._shapes) - SHAPES + 1]:
                self._shapes.pop(oldest, None)
            self._shapes[key] = made
            return made
        return self._shapes[key]

    @cached_property
    def _shapes(self) -> dict[bytes, Surrogate]:
        """Models of the last few shapes, by their parameters."""
        return {}

    def require_stochastic(self, **options: int | None) -> None:
        """Raise InputError if pass options are given for a network that is not stochastic."""
        for name, value in options.items():
            if value is not None and not self.is_stochastic:
                raise InputError(
                    f"{name} {value}: passes of this network do not differ, expected one with "
                    "probabilistic weights or dropout",
                    name,
                )

    @property
    def run(self) -> RunFolder:
        """The run folder; InputError if the network was not loaded from one."""
        if self.folder is None:
            raise InputError("the network was not loaded from a run folder, expected a saved run")
        return RunFolder(self.folder)

    @cached_property
    def fast_estimate(self) -> FastEstimate:
        """Estimate of errors without a factorisation."""
        from surrogate.mechanics.certify.fast_estimate import FastEstimate

        return FastEstimate(self.body.driven_body)

    @cached_property
    def fast_certificate(self) -> FastCertificate:
        """The calibrated bounds of the run; InputError if it has none."""
        from surrogate.mechanics.certify.fast_certificate import FastCertificate, read_calibration

        estimate, run = self.fast_estimate, self.run
        run.seal.require_intact(run.fast_certificate)
        return FastCertificate(estimate, *read_calibration(run.fast_certificate))

    def fast_of_level(self, level: float) -> FastCertificate:
        """Return the calibrated bounds; InputError if they have no such level."""
        fast = self.fast_certificate
        try:
            fast.factor(level)
        except ValueError as error:
            raise InputError(f"level {level:g}: {error}", "level") from None
        return fast

    @cached_property
    def bounds_of_components(self) -> FastCertificate | None:
        """What gives intervals of components their size; None if the run has no such bounds."""
        if self.folder is None or not self.run.fast_certificate.is_file():
            return None
        try:
            fast = self.fast_of_level(LEVEL)
        except InputError:  # of another version, or of too few samples
            return None
        return fast if fast.knows_components and fast.calibrated is not None else None

    @cached_property
    def intervals(self) -> Intervals:
        """The conformal intervals of the run; InputError if it has none."""
        from surrogate.mechanics.certify.conformal import Intervals

        run = self.run
        run.seal.require_intact(run.intervals)
        return Intervals.read(run.intervals)

    def score_scale(self, predicted: Distribution) -> ArrayLike:
        """Divisor of errors in conformal scores: σ in m, or 1 m if the network predicts none."""
        return predicted.std if self.is_probabilistic else 1.0


def make_surrogate(
    tensors: Mapping[str, Tensor], description: RunDescription, device: str = "cpu"
) -> Surrogate:
    """Make a surrogate from the tensors of ``model.safetensors``.

    Raises
    ------
    KeyError, IndexError, RuntimeError, ValueError
        If the tensors do not fit the description.
    """
    on_cpu = {name: tensor.cpu() for name, tensor in tensors.items()}
    config, data = description.run, description.data
    geometry = Geometry.from_tensors(on_cpu, data.cell_type)
    geometry = with_elements(geometry, data.case, data.forces)
    material = data.material if config.needs_material else None
    network = config.build_for(
        geometry, data.info, material, data.case, description.has_series_of_before
    )
    network.load_state_dict({k: v for k, v in on_cpu.items() if not k.startswith(PREFIX)})
    return Surrogate(network.to(device), geometry, description)
