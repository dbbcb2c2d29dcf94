r"""Correction of a prediction: Newton's method with a line search on the potential energy.

.. math:: u_{k+1} = u_k + α δ(u_k), \qquad Π(u_k + α δ) \le Π(u_k) + c \, α \, r(u_k) · δ

with the largest :math:`α = 2^{-m}` and c = 1e-4 (Armijo's rule). Where the difference of Π drowns
in rounding errors, its slope decides (Hager and Zhang 2005, Eq. 4.1):
:math:`r(u_k + α δ) · δ \le (2 c - 1) \, r(u_k) · δ`. Π is infinite where a cell is inverted, so no
step inverts one, and Π decreases along every δ (`surrogate.mechanics.equilibrium.out_of_balance`);
so every start leads to an equilibrium. A good prediction saves iterations. A bad one could cost
many, or lead to another equilibrium; therefore the start is the state of lowest Π among the
prediction, the linear response :math:`K(0)^{-1} f` (halved until no cell is inverted) and the
undeformed body.

A start may lead to an unstable equilibrium, as a straight column does under a force above that of
Euler. Where K is not positive definite, the iteration goes on from a state beside it, along its
lowest mode in the direction of the body's imperfection, where Π is less. So every correction ends
in a stable equilibrium. A body may have several of them.

The iteration ends by the rule of the finite elements
(`shared_schema.common.bodies.equilibrium`). Under a load that is hidden by rounding errors it
is one step from the undeformed body.

Where the volumes of the cells change as a whole, the prediction's are made right first
(`surrogate.mechanics.solids.mixed_elements`), and where elements have points between the nodes,
these are moved to where they are in equilibrium (`surrogate.mechanics.equilibrium.quadratic`).

Under pressures that follow the surface there is no Π. The start is then the prediction, unless the
undeformed body has the shorter step, and steps are `damped`. These can stall, or end where the body
is not stable. If so within 15 of them, the load is increased from nothing, in steps that are halved
where no stable equilibrium is found, as `datagen` does.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.equilibrium import LOOSEST, ForceTolerance
from shared_schema.common.errors import WorkError
from shared_schema.common.progress import LoadProgress
from shared_schema.common.units import SI, Units
from surrogate.mechanics.equilibrium.out_of_balance import FIRST_SHIFT, Equilibrium

Array = NDArray[np.float64]
DEFAULT = ForceTolerance()
ITERATIONS, HALVINGS = 200, 40
SUFFICIENT = 1e-4  # c
LAST_STEP = 1e-3  # of the displacement: largest step after which the tangent before it will do
SMALL_SHIFT = 1e-6  # first τ beside an unstable equilibrium, which may be so nearly stable
AMPLITUDE = 0.1  # of a step along a mode, over the size of a cell
SMALLEST_STEP, STEP_ITERATIONS = 1e-3, 15  # under pressures: of a load that is increased


@dataclass(frozen=True)
class Correction:
    """An equilibrium, and how it was found.

    Attributes
    ----------
    displacement : array, (n_nodes, d)
        In m.
    start : str
        Start with the lowest energy: "prediction", "linear response" or "undeformed body"; or
        "undeformed body by load steps".
    iterations : int
        Number of Newton iterations, or of directions.
    residual_norm : float
        ‖r‖₂ of the displacement in N.
    left : int
        Number of unstable equilibria that were met and left.
    units : Units
        Their labels, for messages.
    by : str
        What has led there: "Newton iterations", or "directions" to the end, with factors of the
        undeformed body (`surrogate.mechanics.descent.equilibria`).
    """

    displacement: Array
    start: str
    iterations: int
    residual_norm: float
    left: int = 0
    units: Units = SI
    by: str = "Newton iterations"

    def summary(self) -> str:
        """Describe the correction in a line."""
        past = f", past {self.left} unstable equilibria" if self.left > 1 else ""
        past = ", past an unstable equilibrium" if self.left == 1 else past
        return (
            f"corrected in {self.iterations} {self.by} from the {self.start}{past}, "
            f"residual {self.residual_norm:.2g} {self.units.force}"
        )


def correct(
    equilibrium: Equilibrium,
    forces: Array,
    predicted: Array,
    tolerance: ForceTolerance | float = DEFAULT,
) -> Correction:
    """Go on from a prediction to the equilibrium.

    Parameters
    ----------
    equilibrium : Equilibrium
    forces, predicted : array, (n_nodes, d)
        A load in N, what acts between the nodes after the nodal forces, and predicted
        displacements in m, which may be arbitrarily wrong.
    tolerance : ForceTolerance or float
        On ‖r‖₂ of the result, or an absolute one in N; 1e-9 of the load by default.

    Raises
    ------
    WorkError
        If 200 iterations, or under pressures load steps, do not lead to an equilibrium.
    """
    f, u = equilibrium.posed(forces[None], predicted[None])
    with closing(LoadProgress("surrogate: correction", equilibrium.units.force)) as progress:
        found = _of_hidden_load(equilibrium, f)
        if found is None:
            start, u = safest_start(equilibrium, f, u)
            try:
                found = stable_state(equilibrium, f, u, start, tolerance, progress)
            except WorkError:
                if equilibrium.following is None:
                    raise
                found = increased(equilibrium, f, tolerance, progress)
    return replace(found, displacement=found.displacement[: equilibrium.nodes])


def _of_hidden_load(equilibrium: Equilibrium, f: Array) -> Correction | None:
    """Step from the undeformed body under a load that rounding errors of r hide; None otherwise."""
    load = equilibrium.at_rest(f)
    if not 0 < LOOSEST * np.linalg.norm(load) < equilibrium.round_off.at_rest:
        return None  # Π feels it
    u = equilibrium.linear_response(load)
    residual = float(np.linalg.norm(equilibrium.out_of_balance(u, f)))
    if residual > equilibrium.round_off.floor(float(np.linalg.norm(u))):
        return None
    return Correction(u[0], "undeformed body", 1, residual, units=equilibrium.units)


def stable_state(
    equilibrium: Equilibrium,
    f: Array,
    u: Array,
    start: str,
    tolerance: ForceTolerance | float = DEFAULT,
    progress: LoadProgress | None = None,
) -> Correction:
    """Iterate as `iterated` does, under pressures a few times, and look whether that is stable.

    Raises
    ------
    WorkError
        If no stable equilibrium is found.
    """
    if equilibrium.following is None:
        return iterated(equilibrium, f, u, start, tolerance, progress=progress)
    found = iterated(equilibrium, f, u, start, tolerance, STEP_ITERATIONS, progress)
    if equilibrium.response_at(found.displacement) is None:
        raise WorkError("the equilibrium is not stable")
    return found


def increased(
    equilibrium: Equilibrium,
    f: Array,
    tolerance: ForceTolerance | float = DEFAULT,
    progress: LoadProgress | None = None,
) -> Correction:
    """Increase a load, dead forces f (1, n_nodes, d) and pressures, from nothing.

    Raises
    ------
    WorkError
        If a thousandth of the load has no stable equilibrium next to the last one.
    """
    following = equilibrium.following
    assert following is not None
    u, iterations, reached, step = np.zeros_like(f), 0, 0.0, 0.25
    while reached < 1:
        part = min(1.0, reached + step)
        under, start = equilibrium.under(following.scaled(part)), "undeformed body by load steps"
        if progress is not None:
            progress.begin(reached, part)
        try:
            found = stable_state(under, part * f, u, start, tolerance, progress)
        except WorkError:
            step /= 2
            if step < SMALLEST_STEP:
                raise WorkError(f"no stable equilibrium beyond {reached:.3g} of the load") from None
        else:
            u, reached, iterations = found.displacement[None], part, iterations + found.iterations
    return replace(found, iterations=iterations)


def iterated(
    equilibrium: Equilibrium,
    f: Array,
    u: Array,
    start: str,
    tolerance: ForceTolerance | float = DEFAULT,
    most: int | None = None,
    progress: LoadProgress | None = None,
) -> Correction:
    """Iterate from a start without inverted cells, f and u (1, n_nodes, d), and show progress.

    Raises
    ------
    WorkError
        If `most` iterations, 200 by default, do not lead to an equilibrium.
    """
    if not isinstance(tolerance, ForceTolerance):
        tolerance = ForceTolerance(absolute=tolerance)
    r, dead = equilibrium.out_of_balance(u, f), equilibrium.has_potential
    load = float(np.linalg.norm(equilibrium.at_rest(f) * equilibrium.free))
    if equilibrium.springs is not None:  # whose forces are not known before
        pushed = equilibrium.springs.forces(u[0])
        load = max(load, float(np.linalg.norm(pushed)), float(np.linalg.norm(r)))
    left, stable = 0, False  # stable is what the last tangent says of u
    for iteration in range((most or ITERATIONS) + 1):
        norm, size = float(np.linalg.norm(r)), float(np.linalg.norm(u))
        small = tolerance.under(load, equilibrium.round_off, size)
        if progress is not None:
            progress.step(iteration, norm, small)
        if norm <= small:
            mode = None if stable or not dead else equilibrium.unstable_mode(u)
            if mode is None:
                return Correction(u[0], start, iteration, norm, left, equilibrium.units)
            advanced, left = _beside(equilibrium, f, u, mode), left + 1
        elif dead:
            step, definite = equilibrium.newton_step(u, r, SMALL_SHIFT if left else FIRST_SHIFT)
            advanced = searched(equilibrium, f, u, r, step)
            stable = definite and float(np.linalg.norm(step)) <= LAST_STEP * size
        else:
            advanced = damped(equilibrium, f, u, r)
        if advanced is None:
            break
        u, r = advanced
    of = equilibrium.units.force
    raise WorkError(f"no equilibrium after {iteration} Newton iterations, residual {norm:.2g} {of}")


def searched(
    equilibrium: Equilibrium, f: Array, u: Array, r: Array, step: Array
) -> tuple[Array, Array] | None:
    """Search along a step: the next displacement with its r; None if Π does not decrease.

    All arrays are (1, n_nodes, d).
    """
    slope = float((r * step).sum())
    for part, trial, change, new in _lower_states(equilibrium, f, u, step):
        decreases = change <= SUFFICIENT * part * slope
        if decreases or float((new * step).sum()) <= (2 * SUFFICIENT - 1) * slope:
            return trial, new
    return None


def _beside(
    equilibrium: Equilibrium, f: Array, u: Array, mode: Array
) -> tuple[Array, Array] | None:
    """Step from an unstable equilibrium along its lowest mode: as `searched`."""
    largest = AMPLITUDE * equilibrium.cell_size / np.abs(mode).max()
    for _, trial, change, new in _lower_states(equilibrium, f, u, largest * mode):
        if change < -equilibrium.rounding or float((new * mode).sum()) < 0.0:
            return trial, new
    return None


def damped(equilibrium: Equilibrium, f: Array, u: Array, r: Array) -> tuple[Array, Array] | None:
    r"""Step to a state that is closer to equilibrium, by the simplified step from there.

    With the largest :math:`α = 2^{-m}` for which :math:`‖K(u)^{-1} r(u + α δ)‖ \le (1 - α / 4) \,
    ‖δ‖` (Deuflhard 2004, Section 3.3). It needs no Π. Arguments and result are as of `searched`.
    """
    inverse, _ = equilibrium.inverse_at(u)
    step = -inverse(r)
    for halving in range(HALVINGS):
        part = 0.5**halving
        trial = u + part * step
        if equilibrium.inverted(trial)[0]:
            continue
        new = equilibrium.out_of_balance(trial, f)
        if np.linalg.norm(inverse(new)) <= (1 - part / 4) * np.linalg.norm(step):
            return trial, new
    return None


def _lower_states(
    equilibrium: Equilibrium, f: Array, u: Array, step: Array
) -> Iterator[tuple[float, Array, float, Array]]:
    """Yield α, u + α δ, the change of Π, and r there, of all α = 1, 1/2, … without a higher Π."""
    potential = equilibrium.potential(u, f)
    for halving in range(HALVINGS):
        part = 0.5**halving
        trial = u + part * step
        change = float((equilibrium.potential(trial, f) - potential)[0])
        if not change > equilibrium.rounding:
            yield part, trial, change, equilibrium.out_of_balance(trial, f)


def safest_start(equilibrium: Equilibrium, f: Array, predicted: Array) -> tuple[str, Array]:
    """Choose the start of lowest potential energy, or nearest to equilibrium under pressures.

    Its name, and the displacement.

    Parameters
    ----------
    equilibrium : Equilibrium
    f, predicted : array, (1, n_nodes, d)
        In N and m.
    """
    linear = equilibrium.linear_response(equilibrium.at_rest(f))
    held = np.where(equilibrium.free, predicted, 0.0)
    if np.isfinite(held).all() and not equilibrium.inverted(held).any():
        held = equilibrium.relaxed(held, f)
    if equilibrium.following is not None:
        if np.isfinite(held).all() and not equilibrium.inverted(held)[0]:
            step, _ = equilibrium.newton_step(held, equilibrium.out_of_balance(held, f))
            if np.linalg.norm(step) <= np.linalg.norm(linear):
                return "prediction", held
        return "undeformed body", 0 * f
    while equilibrium.inverted(linear).any():
        linear = linear / 2
    linear = equilibrium.relaxed(linear, f)
    starts = {
        "prediction": held,
        "linear response": linear,
        "undeformed body": np.zeros_like(f),
    }
    potentials = {
        name: float(equilibrium.potential(u, f)[0])
        for name, u in starts.items()
        if np.isfinite(u).all()
    }
    name = min(potentials, key=lambda key: potentials[key])
    return name, starts[name]
