"""A trained network with its body: solutions, certificates and corrections of predictions."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from contextlib import closing
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shared_schema.common.arguments.checked_arguments import checked_arguments
from shared_schema.common.arguments.real_numbers import real_numbers
from shared_schema.common.bodies.displacement_size import size_warning
from shared_schema.common.bodies.force_tolerance import ForceTolerance
from shared_schema.common.errors import InputError, WorkError
from shared_schema.common.progress import Progress
from surrogate.inference.given_load import (
    Load,
    checked_load,
    checked_loads,
    following,
    given_load,
    without_pressure,
)
from surrogate.inference.prediction import certain
from surrogate.inference.trained_network import TrainedNetwork
from surrogate.mechanics.follower_pressure import FollowerPressure
from surrogate.probabilistic.distribution import Distribution
from surrogate.probabilistic.stochastic_passes import PASSES
from surrogate.runs.folder import RunFolder

if TYPE_CHECKING:
    from shared_schema.tools import Tool
    from surrogate.certify import (
        Bounds,
        Certificate,
        Correction,
        ErrorCertificate,
        FastCertificate,
        FastEstimate,
        Intervals,
    )
    from surrogate.inference.solution import Solution
    from surrogate.touch.grip import Held

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)
LEVEL = 0.95  # probability of fast bounds


class Surrogate(TrainedNetwork):
    """A trained network that certifies and corrects its predictions.

    Its attributes are those of `TrainedNetwork`.
    """

    @checked_arguments
    def solve(
        self,
        load: Load = (),
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
    ) -> Solution:
        """Predict one load case; certify or correct it.

        Parameters
        ----------
        load : array (n_nodes or n_points, d), Tensor, str, Path or sequence of str and Path
            Nodal forces in N, and after these, of elements with points between the nodes, the
            forces there (`Solution.load`); or texts as ``--load`` takes them, such as "4,1:0,-1.5"
            (a force in N at the node there), "top:0,-2" (on a group of the mesh) or "top:5" (a
            pressure in Pa), and files as ``--forces`` takes them. All act together.
        held : mapping of str to displacements, or sequence of str, optional
            Places and groups that are held at displacements in m, such as {"4,1": (0.02, None)},
            or texts as ``--hold`` takes them, such as "4,1:0.02,-"; the solution's `force` holds
            the forces that do it (`surrogate.Grip`).
        tool : Tool or str, optional
            A rigid tool of `shared_schema.tools` that the surface keeps out of, without friction,
            or a text as ``--tool`` takes it, such as "sphere:3,1.2:0.3"; the solution's `force`
            holds its forces, and `contact` says more (`surrogate.Touch`).
        body_force : str or sequence of d floats, optional
            A force in N per m³ of the undeformed body that acts everywhere, such as its weight.
        young_modulus : float, optional
            Young's modulus at rest in Pa, of a body of one material: by default that of the run
            (`surrogate.inference.stiffness`).
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
            (`surrogate.descent`).
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

        Raises
        ------
        InputError
            If the load is wrong, an option needs another one, or the run lacks what it needs.
        WorkError
            If no equilibrium is found.
        """
        from surrogate.inference.solution import Solution
        from surrogate.inference.stiffness import stiffened, stiffness_factor
        from surrogate.touch.unknown_forces import gripped, pushed

        require_options_fit(certify, correct, tolerance, budget, level)
        level = LEVEL if level is None else level
        intervals = self.intervals if conformal else None
        fast = self._fast_of_level(level) if certify == "fast" else None
        self.require_stochastic(passes=passes, seed=seed)
        needed = held is None and tool is None
        given = given_load(self.geometry, load, nearest, body_force, needed=needed)
        factor = stiffness_factor(self.description.data.material, young_modulus)
        given.scale(1 / factor)
        frame, contact = None, None
        if held is not None:
            if tool is not None:
                raise InputError("held and tool: expected one of them")
            frame = gripped(self, held, given, nearest, correct, tolerance)
            nodes = len(given.forces)
            given.forces += frame.force[:nodes]
            given.between[: len(frame.force) - nodes] += frame.force[nodes:]
        elif tool is not None:
            contact = pushed(self, tool, given, correct, tolerance)
            given.forces += np.where(self.geometry.held, 0.0, contact.force)
        force = given.at_rest
        passes = PASSES if passes is None else passes
        dead, pressure = given.load, following(given)
        last_term = math.inf
        if self.predictor.series is None:
            network = self.averaged_passes(force, passes, seed or 0)
        else:
            mean, (last_term,) = self.predictor.under(dead, pressure, force)
            network = certain(mean)
        weighs = body_force is not None
        self.training_range.log(force, weighs)
        interval = None
        if intervals is not None and conformal is not None:
            interval = intervals.bounds(conformal, network.mean, self.score_scale(network))
        displacement, correction, descent = network.mean, None, None
        sought = contact if frame is None else frame
        if sought is not None and sought.correction is not None:
            correction = sought.correction
            displacement = correction.displacement
        elif correct:
            correction = self._corrected(dead, pressure, network.mean)
            displacement = correction.displacement
        elif tolerance is not None or budget is not None:
            from surrogate.descent.aim import Aim

            aim = Aim(tolerance, budget, in_metres=certify is not None)
            displacement, descent = self.descend(
                dead, pressure, network.mean, aim, float(last_term)
            )
        is_own = np.array_equal(displacement, network.mean)
        is_own = is_own or (descent is not None and descent.kept)
        what = f"the largest {'predicted' if correction is None else 'corrected'} displacement"
        if force.any():
            advice = self.training_range.compared(force, weighs)
            unusual = size_warning(displacement, self.geometry.coordinates, what, advice)
            if unusual is not None:
                logger.warning(unusual)
        certificate: ErrorCertificate | None = None
        if certify == "full":
            certificate = self._certified(dead, pressure, displacement)
        std = network.std if self.is_probabilistic and is_own else None
        of_components = fast if fast is not None or std is None else self._bounds_of_components
        half_width = None
        if of_components is not None:
            bounds = of_components.certify(dead, displacement, level, std, pressure)
            half_width = bounds.half_width
            certificate = certificate if fast is None else bounds
        told = certificate is not None or correction is not None
        told = told or (descent is not None and descent.reached is not None)
        outside = tuple(self.training_range.exceeded(force, weighs).values())
        one_direction = None
        if not told and (outside or self._knows_compliance):
            one_direction = self._one_direction(dead, pressure, displacement)
        solution = Solution(
            geometry=self.geometry,
            case=self.description.run.case,
            force=force,
            force_between=given.at_rest_between,
            displacement=displacement.copy(),
            predicted=network.mean,
            distribution=network if self.is_probabilistic and is_own else None,
            interval=interval if is_own else None,
            correction=correction,
            descent=descent,
            certificate=certificate,
            half_width=half_width,
            tolerance=tolerance,
            stresses=self._stresses_of(dead, pressure, displacement) if stresses else {},
            reaction=self.reactions_under(dead, pressure, displacement) if stresses else None,
            notes=tuple(given.notes),
            grips=None if frame is None else frame.reactions,
            contact=contact,
            one_direction=one_direction,
            outside_training=outside,
            units=self.description.data.units,
        )
        return solution if young_modulus is None else stiffened(solution, factor)

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
        from surrogate.inference.stiffness import with_zones

        return with_zones(self, moduli)

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
        dead, follows = without_pressure(self.geometry, loads, pressure)
        return self._certified(dead, follows, self._displacement(loads, predicted))

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
        fast, loads, std = self._fast_of_level(level), checked_loads(self.geometry, forces), None
        dead, follows = without_pressure(self.geometry, loads, pressure)
        if predicted is None and self.is_probabilistic:
            network = self.predictor.distribution(loads, PASSES, 0)
            predicted, std = network.mean, network.std
        return fast.certify(dead, self._displacement(loads, predicted), level, std, follows)

    def _stresses_of(
        self, dead: Array, pressure: FollowerPressure | None, displacement: Array
    ) -> dict[str, Array]:
        found = self.stresses_under(dead, pressure, displacement)
        return {name: values[0] for name, values in found.items()}

    def _certified(
        self, dead: Array, pressure: FollowerPressure | None, displacement: Array
    ) -> Certificate:
        from surrogate.certify.full_certificate import certify, certify_each

        if pressure is None:
            return certify(self._iterating, dead, displacement)
        return certify_each(self._iterating, pressure, dead, displacement)

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
        dead, follows = without_pressure(self.geometry, load, pressure)
        return self._corrected(dead, follows, self._displacement(load, predicted))

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
        dead, follows = without_pressure(self.geometry, loads, pressure)
        displacement, found = self._displacement(loads, predicted), []
        progress = Progress(len(loads), unit="loads", title="surrogate: corrections", passing=True)
        with closing(progress):
            for number in range(len(loads)):
                one = None if follows is None else follows[slice(number, number + 1)]
                try:
                    found.append(self._corrected(dead[number], one, displacement[number]))
                except WorkError as error:
                    raise WorkError(f"load {number}: {error}") from None
                progress.update(number + 1)
        return found

    def _corrected(
        self, dead: Array, pressure: FollowerPressure | None, displacement: Array
    ) -> Correction:
        from surrogate.certify.correction import correct

        tolerance = ForceTolerance.of_case(self.description.data.case)
        return correct(self.under(pressure), dead, displacement, tolerance)

    def _displacement(self, loads: Array, predicted: ArrayLike | None) -> Array:
        """Return given displacements, checked; predict them if they are not given."""
        nodal = loads[..., : len(self.geometry.coordinates), :]
        if predicted is None:
            return self.predictor.respond(loads)[0]
        displacement = real_numbers(predicted, "predicted displacements")
        if displacement.shape != nodal.shape:
            raise InputError(f"predicted has shape {displacement.shape}, expected {nodal.shape}")
        return displacement

    @property
    def run(self) -> RunFolder:
        """The run folder; InputError if the network was not loaded from one."""
        if self.folder is None:
            raise InputError("the network was not loaded from a run folder, expected a saved run")
        return RunFolder(self.folder)

    @cached_property
    def fast_estimate(self) -> FastEstimate:
        """Estimate of errors without a factorisation."""
        from surrogate.certify.fast_estimate import FastEstimate

        geometry = self.geometry
        alone = geometry.pressed is None and not geometry.has_points_between
        return FastEstimate(self.equilibrium, self.blocks if alone else None)

    @cached_property
    def fast_certificate(self) -> FastCertificate:
        """The calibrated bounds of the run; InputError if it has none."""
        from surrogate.certify.fast_certificate import FastCertificate, read_calibration

        estimate, run = self.fast_estimate, self.run
        run.seal.require_intact(run.fast_certificate)
        return FastCertificate(estimate, *read_calibration(run.fast_certificate))

    def _fast_of_level(self, level: float) -> FastCertificate:
        """Return the calibrated bounds; InputError if they have no such level."""
        fast = self.fast_certificate
        try:
            fast.factor(level)
        except ValueError as error:
            raise InputError(f"--level {level:g}: {error}") from None
        return fast

    @cached_property
    def _bounds_of_components(self) -> FastCertificate | None:
        """What gives intervals of components their size; None if the run has no such bounds."""
        if self.folder is None or not self.run.fast_certificate.is_file():
            return None
        try:
            fast = self._fast_of_level(LEVEL)
        except InputError:  # of another version, or of too few samples
            return None
        return fast if fast.knows_components and fast.calibrated is not None else None

    @cached_property
    def intervals(self) -> Intervals:
        """The conformal intervals of the run; InputError if it has none."""
        from surrogate.certify.conformal import Intervals

        run = self.run
        run.seal.require_intact(run.intervals)
        return Intervals.read(run.intervals)

    def score_scale(self, predicted: Distribution) -> ArrayLike:
        """Divisor of errors in conformal scores: σ in m, or 1 m if the network predicts none."""
        return predicted.std if self.is_probabilistic else 1.0


def require_options_fit(
    certify: str | None,
    correct: bool,
    tolerance: float | None,
    budget: float | None,
    level: float | None,
) -> None:
    """Raise InputError if an option of `Surrogate.solve` is wrong, or lacks one that it needs."""
    from surrogate.descent.aim import require_positive

    require_positive("tolerance", tolerance)
    require_positive("budget", budget)
    if tolerance is not None and correct and not certify:
        raise InputError(f"--tolerance {tolerance}: expected --certify beside --correct")
    if budget is not None and correct:
        raise InputError(f"--budget {budget}: expected without --correct, which has no limit")
    if level is not None and certify != "fast":
        raise InputError(f"--level {level}: expected beside --certify fast")
