"""One load case from its description to a `Solution`: what `Surrogate.solve` does."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.equilibrium import size_warning
from shared_schema.common.errors import InputError
from surrogate.learning.inference.prediction import certain
from surrogate.learning.inference.solution import Solution, stiffened
from surrogate.learning.probabilistic.distribution import Distribution
from surrogate.learning.probabilistic.stochastic_passes import PASSES
from surrogate.mechanics.body.stiffness import stiffness_factor
from surrogate.mechanics.certify.certificate_protocol import LEVEL, ErrorCertificate
from surrogate.mechanics.descent.aim import Aim, require_positive
from surrogate.mechanics.statics.load import GivenLoad, Load, given_load

if TYPE_CHECKING:
    from shared_schema.tools import Tool
    from surrogate.learning.inference.surrogate import Surrogate
    from surrogate.mechanics.touch.grip import GripFrame, Held
    from surrogate.mechanics.touch.touch import TouchFrame

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Wanted:
    """What is asked for beside the displacement: the options of `Surrogate.solve`.

    Raises
    ------
    InputError
        If an option is wrong, or lacks one that it needs.
    """

    held: Held | None
    tool: str | Tool | None
    body_force: str | Sequence[float] | None
    young_modulus: float | None
    certify: Literal["fast", "full"] | None
    correct: bool
    tolerance: float | None
    budget: float | None
    level: float | None
    conformal: Literal["marginal", "simultaneous"] | None
    stresses: bool
    nearest: bool
    passes: int | None
    seed: int | None

    def __post_init__(self) -> None:
        require_positive("tolerance", self.tolerance)
        require_positive("budget", self.budget)
        if self.tolerance is not None and self.correct and not self.certify:
            raise InputError(
                f"tolerance {self.tolerance}: expected certify beside correct", "tolerance"
            )
        if self.budget is not None and self.correct:
            raise InputError(
                f"budget {self.budget}: expected without correct, which has no limit", "budget"
            )
        if self.level is not None and self.certify != "fast":
            raise InputError(f"level {self.level}: expected beside certify='fast'", "level")
        if self.held is not None and self.tool is not None:
            raise InputError("held and tool: expected one of them")

    @property
    def aim(self) -> Aim | None:
        """What directions aim at; None if there are to be none."""
        if self.correct or (self.tolerance is None and self.budget is None):
            return None
        return Aim(self.tolerance, self.budget, in_metres=self.certify is not None)


def solved(model: Surrogate, load: GivenLoad, wanted: Wanted) -> Solution:
    """Predict one load case; certify or correct it: see `Surrogate.solve`."""
    body, level = model.body, LEVEL if wanted.level is None else wanted.level
    intervals = model.intervals if wanted.conformal else None
    fast = model.fast_of_level(level) if wanted.certify == "fast" else None
    model.require_stochastic(passes=wanted.passes, seed=wanted.seed)
    needed = wanted.held is None and wanted.tool is None
    given = given_load(model.geometry, load, wanted.nearest, wanted.body_force, needed=needed)
    factor = stiffness_factor(body.material, wanted.young_modulus)
    given.scale(1 / factor)
    grip: GripFrame | None = None
    contact: TouchFrame | None = None
    if wanted.held is not None or wanted.tool is not None:
        from surrogate.learning.inference.sought_forces import with_sought_forces

        grip, contact = with_sought_forces(model, given, wanted)
    force, acting = given.at_rest, Load.of(model.geometry, given)
    weighs = wanted.body_force is not None
    network, last_term = predicted(model, acting, force, wanted)
    model.training_range.log(force, weighs)
    interval = None
    if intervals is not None and wanted.conformal is not None:
        scale = model.score_scale(network)
        interval = intervals.bounds(wanted.conformal, network.mean, scale)
    sought = contact if grip is None else grip
    correction, descent = None if sought is None else sought.correction, None
    if correction is None and wanted.correct:
        correction = body.correct(acting, network.mean)
    if correction is not None:
        displacement = correction.displacement
    elif wanted.aim is not None:
        displacement, descent = body.descend(acting, network.mean, wanted.aim, last_term)
    else:
        displacement = network.mean
    is_own = np.array_equal(displacement, network.mean)
    is_own = is_own or (descent is not None and descent.kept)
    if force.any():
        what = f"the largest {'predicted' if correction is None else 'corrected'} displacement"
        advice = model.training_range.compared(force, weighs)
        unusual = size_warning(displacement, model.geometry.coordinates, what, advice)
        if unusual is not None:
            logger.warning(unusual)
    certificate: ErrorCertificate | None = None
    if wanted.certify == "full":
        certificate = body.certify(acting, displacement)
    std = network.std if model.is_probabilistic and is_own else None
    of_components = fast if fast is not None or std is None else model.bounds_of_components
    half_width = None
    if of_components is not None:
        bounds = of_components.certify(acting.dead, displacement, level, std, acting.following)
        half_width = bounds.half_width
        certificate = certificate if fast is None else bounds
    told = certificate is not None or correction is not None
    told = told or (descent is not None and descent.reached is not None)
    outside = tuple(model.training_range.exceeded(force, weighs).values())
    one_direction = None
    if not told and (outside or model.network.linear is not None or body.is_small):
        one_direction = body.one_direction(acting, displacement)
    stresses, reaction = {}, None
    if wanted.stresses:
        fields = body.stresses_under(acting, displacement)
        stresses = {name: values[0] for name, values in fields.items()}
        reaction = body.reactions_under(acting, displacement)
    solution = Solution(
        geometry=model.geometry,
        case=model.description.run.case,
        force=force,
        force_between=given.at_rest_between,
        displacement=displacement.copy(),
        predicted=network.mean,
        distribution=network if model.is_probabilistic and is_own else None,
        interval=interval if is_own else None,
        correction=correction,
        descent=descent,
        certificate=certificate,
        half_width=half_width,
        tolerance=wanted.tolerance,
        stresses=stresses,
        reaction=reaction,
        notes=tuple(given.notes),
        grips=None if grip is None else grip.reactions,
        contact=contact,
        one_direction=one_direction,
        outside_training=outside,
        units=body.units,
    )
    return solution if wanted.young_modulus is None else stiffened(solution, factor)


def predicted(
    model: Surrogate, load: Load, force: Array, wanted: Wanted
) -> tuple[Distribution, float]:
    """Displacements in m, and what the last term of a load series adds at most; else infinity."""
    if model.predictor.series is None:
        passes = PASSES if wanted.passes is None else wanted.passes
        return model.averaged_passes(force, passes, wanted.seed or 0), math.inf
    mean, (last,) = model.predictor.respond(load)
    return certain(mean), float(last)
