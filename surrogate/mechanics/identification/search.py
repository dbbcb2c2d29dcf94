"""The search for parameters: fits of predictions, then fits without their error.

Places of a force are ranked by the linear body (`surrogate.mechanics.identification.candidates`).
The first ones are fitted, with the predictions in place of the linear body. What these move the
markers more than the linear body does, under the best force found, is then taken from the measured
displacements, and the places are ranked again, until no new ones are among the first. As a rule
many places fit as well as the best one, within the noise: the last ranking names all that may bear
the force.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.errors import InputError, WorkError
from surrogate.mechanics.descent import Aim
from surrogate.mechanics.descent.driven_body import longest
from surrogate.mechanics.identification.candidates import (
    Candidate,
    Places,
    Start,
    likely_candidates,
)
from surrogate.mechanics.identification.least_squares import Fit, fit, refit, wild_cost
from surrogate.mechanics.identification.responses import (
    CONTACT,
    EquilibriumResponse,
    Response,
    ToolResponse,
)
from surrogate.mechanics.identification.unknowns import SOMEWHERE, Unknowns
from surrogate.mechanics.statics.load import Load
from surrogate.mechanics.statics.prediction import Predictor
from surrogate.mechanics.touch import Touch

Array = NDArray[np.float64]

SOFTER = 0.3  # change of φ that matters
TOLERANCE = 1e-3  # of the error of a prediction, over its largest displacement
OF_NOISE = 0.1  # the same, over the noise of a marker, where that is larger
ASTRAY = 0.01  # of the largest displacement of a marker: how far off a fit may be astray
WITHIN = 3.0  # of the noise of a component: the same
PARTS = (0.25, 0.5, 0.75, 1.0)  # of the way from where a search begins to the markers
RANKINGS = 6  # of places, at most
MANY = 64  # places of one radius that may bear a force


@dataclass(frozen=True)
class Finished:
    """A fit without the error of predictions, that error at the markers in m, and the forces."""

    fit: Fit
    surrogate_error: float
    force: Array


class MarkerFits:
    """Fits of the displacements of markers.

    Parameters
    ----------
    predictor : Predictor
    moved : array, (m, d)
        In m.
    at_markers : csr_array, (m, n_nodes)
    noise : float, optional
        Standard deviation of a component in m.
    """

    def __init__(
        self, predictor: Predictor, moved: Array, at_markers: csr_array, noise: float | None
    ) -> None:
        self._predictor, self._body = predictor, predictor.body
        self._moved, self._at_markers = moved, at_markers
        self._noise, self._size = noise, float(np.abs(moved).max())

    def known(self, unknowns: Unknowns) -> list[Candidate]:
        """Fit forces at known places, and moduli; or the place of a tool."""
        if unknowns.tool is not None:
            scale = np.full(len(unknowns.names), self._size)
            begin = self._response(unknowns, scale).load(0 * scale).dead
            if np.array_equal(begin, unknowns.known):
                raise InputError("tool: it touches nothing, expected it about where it pushes")
            found = self._fitted(unknowns, np.zeros(len(scale)), scale)
            return [Candidate(unknowns, found, scale)]
        strengths = np.abs(self._linear(unknowns.at_rest[1])).max(axis=(0, 1))
        scale = self._scale(strengths, unknowns)
        found = self._fitted(unknowns, self._begin(unknowns), scale)
        return [Candidate(unknowns, found, scale)]

    def _begin(self, unknowns: Unknowns) -> Array:
        """Where the search begins: without forces, or linearly, as zones at rest tell nothing."""
        at_rest, patterns = unknowns.at_rest
        count = len(patterns)
        begin = np.zeros(count + len(unknowns.moduli))
        if unknowns.zones and count:
            known = self._linear(at_rest[None])[..., 0]
            columns = self._linear(patterns).reshape(-1, count)
            begin[:count] = np.linalg.lstsq(columns, (self._moved - known).ravel(), rcond=None)[0]
        return begin

    def somewhere(self, unknowns: Unknowns, radii: Sequence[float]) -> list[Candidate]:
        """Fit a force anywhere on the surface, with all others; the most likely place first.

        Parameters
        ----------
        unknowns : Unknowns
            The others.
        radii : sequence of float
            Radii in m that it may be spread over; 0 on a node alone.
        """
        at_rest, patterns = unknowns.at_rest
        beside, known = self._linear(patterns), self._linear(at_rest[None])[..., 0]
        places = Places(self._body, self._at_markers, beside, radii, self._noise)

        def scale_at(number: int) -> Array:
            return self._scale(places.strengths(number), unknowns)

        def unknowns_at(number: int) -> Unknowns:
            return unknowns.at(places.units(number), SOMEWHERE)

        def fitted(number: int, forces: Array) -> Fit:
            begin = np.append(forces, np.zeros(len(unknowns.moduli)))
            return self._fitted(unknowns_at(number), begin, scale_at(number))

        fits: dict[int, Fit] = {}
        tried: set[int] = set()
        aim = self._moved - known  # what the linear body has to reach
        for _ in range(RANKINGS):
            first, forces = places.ranked(aim)
            if tried.issuperset(first):
                break
            for number, begin in zip(first, forces, strict=True):
                if number not in tried:
                    with suppress(WorkError):
                        fits[number] = fitted(number, begin)
            if not fits:
                raise WorkError("no place of a force is found that fits the markers")
            tried.update(first)
            sigma = min(fit.sigma for fit in fits.values())
            best = min(fits, key=lambda number: wild_cost(fits[number].lengths, sigma))
            moved = places.moved(best, fits[best].theta[: forces.shape[1]])
            aim = self._moved - self._at_markers @ fits[best].state + moved
        numbers, forces = places.ranked(aim, MANY * len(radii))
        moduli = fits[best].theta[forces.shape[1] :]
        begins = {best: fits[best].theta} | {
            number: np.append(begin, moduli)
            for number, begin in zip(numbers, forces, strict=True)
            if number != best
        }
        middles = zip(places.nodes.tolist(), places.radii.tolist(), strict=True)
        of_place = dict(enumerate(middles))
        starts = [
            Start(unknowns_at(number), theta, scale_at(number), *of_place[number])
            for number, theta in begins.items()
        ]
        return likely_candidates(self._predictor, self._moved, self._at_markers, fits[best], starts)

    def finished(self, best: Candidate, confirm: bool) -> Finished:
        """Fit the best candidate once more: without the estimated error, or exactly.

        Raises
        ------
        WorkError
            If no equilibrium is found, or the estimate of the error does not settle.
        """
        given, theta = (
            (self._predictor, best.unknowns, self._at_markers, best.scale),
            best.fit.theta,
        )
        if best.unknowns.zones:
            return Finished(best.fit, 0.0, EquilibriumResponse(*given).at_rest(theta))
        if confirm:
            exact = EquilibriumResponse(*given)
            found = self._refitted(exact, best.fit, exact.field(theta))
            return Finished(found, 0.0, exact.at_rest(found.theta))
        response = self._response(best.unknowns, best.scale)
        state = response.field(theta)
        error = self._error(state, response.load(theta), best.fit.sigma)
        shifted = self._response(best.unknowns, best.scale, -error)
        found = self._refitted(shifted, best.fit, state - error)
        left = float(np.abs(self._at_markers @ error).max())
        return Finished(found, left, shifted.at_rest(found.theta))

    def _error(self, state: Array, load: Load, noise: float) -> Array:
        """Error of the prediction in m: by directions, or, where they do not arrive, Newton steps.

        As precisely as matters beside the noise.

        Raises
        ------
        WorkError
            If neither settles.
        """
        aim = Aim(max(TOLERANCE * longest(state), OF_NOISE * noise), in_metres=True)
        found, descent = self._body.descend(load, state, aim)
        if descent.reached:
            return np.asarray(state - found)
        certificate = self._body.certify(load, state)
        if not certificate.settled:
            raise WorkError(
                "the error of the surrogate cannot be estimated for what is found, expected "
                "'confirm'"
            )
        return np.asarray(certificate.error)

    def _refitted(self, response: Response, begin: Fit, state: Array) -> Fit:
        return refit(response.model, self._moved, begin, state, response.scale, self._noise)

    def _response(self, unknowns: Unknowns, scale: Array, shift: Array | float = 0.0) -> Response:
        """Predictions, or, if moduli of zones are sought, equilibria."""
        given = self._predictor, unknowns, self._at_markers, scale, shift
        if unknowns.tool is not None:
            return ToolResponse(self._touch, *given)
        return EquilibriumResponse(*given) if unknowns.zones else Response(*given)

    @cached_property
    def _touch(self) -> Touch:
        return Touch(self._predictor, CONTACT, corrected=False)

    def _fitted(self, unknowns: Unknowns, begin: Array, scale: Array) -> Fit:
        """The parameters that fit; a search that went astray is led there by parts of the way."""
        model = self._response(unknowns, scale).model
        found = fit(model, self._moved, begin, scale, self._noise)
        if np.median(found.lengths) <= max(ASTRAY * self._size, WITHIN * (self._noise or 0.0)):
            return found
        first, led = model.seen(model.state(begin)), begin
        for part in PARTS:
            target = first + part * (self._moved - first)
            try:
                again = fit(model, target, led, scale, self._noise)
            except WorkError:
                return found
            led = again.theta
        return min(found, again, key=lambda one: float(np.median(one.lengths)))

    def _linear(self, patterns: Array) -> Array:
        """Displacements of the markers by the linear response, (m, d, K)."""
        if not len(patterns):
            return np.zeros((*self._moved.shape, 0))
        body, compliance = self._body.equilibrium, self._body.driven_body.compliance
        fields = compliance.linear_response(body.forces_at_points(patterns))
        seen = [self._at_markers @ field for field in fields[:, : body.nodes]]
        return np.moveaxis(np.array(seen), 0, -1)

    def _scale(self, strengths: Array, unknowns: Unknowns) -> Array:
        """Sizes of changes that matter: those that move a marker as far as they have moved."""
        if not np.all(strengths > 0):
            raise WorkError(
                "the markers do not tell all that is sought: some of it moves none of them"
            )
        return np.append(self._size / strengths, np.full(len(unknowns.moduli), SOFTER))
