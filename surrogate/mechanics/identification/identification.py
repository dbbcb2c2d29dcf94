"""Identification: forces, their place and stiffness of a body from markers that have moved."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared_schema.actuators.control import KINDS, UNITS
from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import InputError
from shared_schema.common.solution_file import write_solution
from shared_schema.common.units import Units
from shared_schema.tools import Tool, parse_tool, require_outside
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.body.stiffness import modulus_at_rest
from surrogate.mechanics.identification.candidates import Candidate
from surrogate.mechanics.identification.markers import (
    SUSPECT,
    Markers,
    noise_probability,
    read_markers,
)
from surrogate.mechanics.identification.responses import moduli_of_zones
from surrogate.mechanics.identification.search import Finished, MarkerFits
from surrogate.mechanics.identification.unknowns import (
    ACTUATOR,
    BODY_FORCE,
    PRESSURE,
    TOOL,
    YOUNG_MODULUS,
    Unknowns,
    is_somewhere,
    radii_of,
    zones_of,
)
from surrogate.mechanics.statics.load import given_load
from surrogate.mechanics.statics.prediction import Predictor

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)
LEVEL = 0.9


@dataclass(frozen=True)
class Identification:
    """What markers tell of a body.

    Attributes
    ----------
    names : tuple of str
        Of the parameters: force components and tensions in N, body forces in N/m³, pressures and
        Young's moduli in Pa, how far a tool is from where it was given, in m.
    values, std, lower, upper : array, (p,)
        Estimates, standard deviations, and ends of intervals of the probability `level`.
    level : float
    place, place_std : array (d,) and float, or None
        Place of the force that acts somewhere, and its uncertainty, in m.
    radius, radius_std : float or None
        Radius that it is spread over, and its uncertainty, in m.
    displacement, std_displacement : array, (n_nodes, d)
        Field and standard deviations in m.
    force : array, (n_nodes, d)
        Nodal forces in N, known and identified ones, with those of pressures on the undeformed
        body.
    noise : float
        Standard deviation of a component of the markers in m, given or estimated.
    left_out : array of bool, (m,)
        Markers that fit no state together with the others.
    noise_probability : float
        Probability that noise alone leaves what the state leaves of the markers
        (`surrogate.mechanics.identification.markers`).
    surrogate_error : float
        Largest estimated error of the surrogate at the markers in m, which is taken out; 0 of a
        confirmed state.
    geometry : Geometry
    """

    names: tuple[str, ...]
    values: Array
    std: Array
    lower: Array
    upper: Array
    level: float
    place: Array | None
    place_std: float | None
    radius: float | None
    radius_std: float | None
    displacement: Array
    std_displacement: Array
    force: Array
    noise: float
    left_out: NDArray[np.bool_]
    noise_probability: float
    surrogate_error: float
    geometry: Geometry

    @property
    def units(self) -> Units:
        """Labels of all numbers."""
        return self.geometry.units

    def lines(self) -> list[str]:
        """Describe the result, a parameter a line."""
        units, found = self.units, []
        for name, value, low, high in zip(
            self.names, self.values, self.lower, self.upper, strict=True
        ):
            unit = units.named(self._unit_of_actuator(name))
            if name.startswith(BODY_FORCE):
                unit = f"{units.force}/{units.length}³"
            elif name.startswith(("young", PRESSURE)):
                unit = units.stress
            elif name.startswith(TOOL):
                unit = units.length
            found.append(f"{name}: {value:.5g} {unit} ({low:.5g} to {high:.5g})")
        if self.place is not None and self.place_std is not None:
            at = ",".join(f"{x:.5g}" for x in self.place)
            found.append(f"place: {at} {units.length}, within {units.written(self.place_std)}")
        if self.radius is not None and self.radius_std is not None:
            radius = "a node alone" if self.radius == 0 else units.written(self.radius)
            found.append(f"radius: {radius}, within {units.written(self.radius_std)}")
        noise = f"noise {units.written(self.noise)}"
        if self.left_out.any():
            noise += f", {self.left_out.sum()} of {len(self.left_out)} markers left out"
        if self.surrogate_error:
            noise += (
                f", error of the surrogate {units.written(self.surrogate_error)} at the markers"
            )
        return [*found, noise]

    def _unit_of_actuator(self, name: str) -> str:
        """N of a cable, and of what is no actuator; Pa of a chamber."""
        placed = self.geometry.actuators
        if placed is None or not name.startswith(ACTUATOR):
            return "N"
        kind = placed.kinds[placed.names.index(name.removeprefix(ACTUATOR))]
        return UNITS[KINDS[kind][1]][0][1]

    def __repr__(self) -> str:
        """Describe the result."""
        return "\n  ".join([f"Identification, intervals of {self.level:.0%}:", *self.lines()])

    @checked_arguments
    def save(self, path: str | Path) -> None:
        """Write displacement, its standard deviation and force to a .npz, .vtu or .xdmf file.

        Raises
        ------
        InputError
            If the file's name has another end, or its folder does not exist.
        """
        mesh = self.geometry.coordinates, self.geometry.cells, self.geometry.cell_type
        fields = {
            "force": self.force,
            "displacement": self.displacement,
            "std": self.std_displacement,
        }
        write_solution(Path(path), *mesh, fields, {})


@checked_arguments
def identify(
    model: Predictor,
    markers: Markers | str | Path,
    unknown: Sequence[str],
    load: Sequence[str] = (),
    *,
    body_force: str | Sequence[float] | None = None,
    tool: str | Tool | None = None,
    noise: float | None = None,
    model_error: float = 0.0,
    level: float = LEVEL,
    nearest: bool = False,
    confirm: bool = False,
) -> Identification:
    """Find forces, the place of a tool, or stiffness of a body from markers that have moved.

    Parameters
    ----------
    model : Surrogate, or Series
    markers : Markers, or path of a file
        At most places on or in the body; some may be wrong.
    unknown : sequence of str
        What is sought: places as loads name them ("4,1", "4,1,0.5,0.2" or a group of the
        mesh), "pressure:GROUP" (which follows the surface), "actuator:NAME" (the pressure or
        tension of an actuator of the case), "somewhere" (one force at an unknown
        node of the surface), "somewhere,R" (spread over it within R m of one), "somewhere,any"
        (within a radius that is sought), "body-force",
        "young-modulus" (of a body of one material, beside a known load) and
        "young-modulus:GROUP" (of a zone, by equilibria of the finite elements); or "tool" alone.
    load, body_force
        Known loads, as `Surrogate.solve` takes them.
    tool : str or Tool, optional
        As `Surrogate.solve` takes it, about where it is: what is found is how far it is from there.
    noise : float, optional
        Standard deviation of a component of the markers in m; it is estimated if it is not given.
    model_error : float
        Standard deviation of the relative error of all displacements of this body, such as 0.05:
        that of its mesh, its material, its supports. Intervals hold for it as well.
    level : float
        Probability of the intervals.
    nearest : bool
        Let places beside a node mean the nearest one.
    confirm : bool
        Go on from the predictions to equilibria of the finite elements.

    Raises
    ------
    InputError
        If an argument is wrong, or more is sought than is measured.
    WorkError
        If the markers do not tell what is sought.
    """
    if isinstance(unknown, str):
        raise InputError("unknown: expected a sequence of texts")
    if noise is not None and not 0 < noise < np.inf:
        raise InputError(f"noise: {noise}, expected more than 0 m, and finite")
    if not 0 <= model_error < 1:
        raise InputError(f"model_error: {model_error}, expected from 0 to less than 1")
    if not 0 < level < 1:
        raise InputError(f"level: {level}, expected more than 0 and less than 1")
    geometry = model.body.geometry
    if not isinstance(markers, Markers):
        markers = read_markers(Path(markers), geometry.dimension)
    at_markers = markers.interpolation(geometry)
    given = given_load(geometry, load, nearest, body_force, needed=False)
    somewhere = [text for text in unknown if is_somewhere(text)]
    if len(somewhere) > 1:
        raise InputError(f"unknown: {', '.join(somewhere)}: expected one force somewhere")
    radii = radii_of(geometry, somewhere[0]) if somewhere else []
    material, moduli = model.body.material, np.empty(0)
    if zones := zones_of(unknown):
        if somewhere or YOUNG_MODULUS in unknown:
            raise InputError(f"unknown: {', '.join(unknown)}: expected zones beside known places")
        moduli = moduli_of_zones(material, zones)
    elif YOUNG_MODULUS in unknown:
        moduli = np.array([modulus_at_rest(material)])
    if isinstance(tool, str):
        tool = parse_tool(tool, geometry.dimension)
    if tool is not None:
        if confirm:
            raise InputError("confirm: expected without a tool, whose contact is predicted")
        require_outside(tool, geometry.coordinates, geometry.free)
    unknowns = Unknowns.of(geometry, unknown, given, moduli, nearest, tool)
    if not model.knows_forces and (len(unknowns.patterns) or somewhere or tool):
        raise InputError(
            f"unknown: {', '.join(unknown)}: the network was trained on pressures and actuators "
            "alone, which tell nothing of forces, expected pressure:GROUP or actuator:NAME"
        )
    count = len(unknowns.names) + geometry.dimension * len(somewhere) + (len(radii) > 1)
    if count >= markers.moved.size:
        raise InputError(
            f"unknown: {count} parameters are sought, and {markers.moved.size} components of "
            "markers measured, expected more of these"
        )
    search = MarkerFits(model, markers.moved, at_markers, noise)
    found = search.somewhere(unknowns, radii) if somewhere else search.known(unknowns)
    best = search.finished(found[0], confirm)
    left = (markers.moved - at_markers @ best.fit.state)[best.fit.counts]
    at_rest = markers.at_rest[best.fit.counts]
    probability = noise_probability(at_rest, left, len(best.fit.theta), noise)
    if probability < SUSPECT:
        logger.warning(
            "the markers are off the state that fits them best by more than noise (probability "
            "%.1g), so that intervals are too short: the body, or where and how the load acts, is "
            "not as assumed%s",
            probability,
            " (somewhere,any seeks a radius)" if radii == [0.0] else "",
        )
    return described(found, best, level, model_error, probability, geometry)


def described(
    likely: list[Candidate],
    best: Finished,
    level: float,
    model_error: float,
    probability: float,
    geometry: Geometry,
) -> Identification:
    """Make the result of the most likely candidates and the best one, finished."""
    theta, unknowns = best.fit.theta, likely[0].unknowns
    covariance, variance = np.zeros((len(theta), len(theta))), np.zeros(best.fit.state.shape)
    place, spread, radius, radius_spread = None, 0.0, None, 0.0
    for candidate in likely:
        off = candidate.fit.theta - likely[0].fit.theta
        within = candidate.fit.with_model_error(model_error)
        covariance = covariance + candidate.share * (within + np.outer(off, off))
        between = candidate.fit.state - likely[0].fit.state
        variance += candidate.share * (candidate.fit.variance(model_error) + between**2)
        if candidate.node is not None and likely[0].node is not None:
            place = geometry.coordinates[likely[0].node]
            distance = np.linalg.norm(geometry.coordinates[candidate.node] - place)
            spread += candidate.share * float(distance) ** 2
            radius = likely[0].radius
            radius_spread += candidate.share * (candidate.radius - radius) ** 2
    std, width = np.sqrt(np.diag(covariance)), best.fit.half_width(level)
    values, lower, upper = theta.copy(), theta - width * std, theta + width * std
    if count := len(unknowns.moduli):
        for ends in (values, lower, upper):
            ends[-count:] = unknowns.young_moduli(ends)
        std[-count:] *= values[-count:]
    factor = np.exp(theta[-1]) if unknowns.softens else 1.0
    return Identification(
        names=unknowns.names,
        values=values,
        std=std,
        lower=lower,
        upper=upper,
        level=level,
        place=place,
        place_std=None if place is None else float(np.sqrt(spread)),
        radius=radius,
        radius_std=None if radius is None else float(np.sqrt(radius_spread)),
        displacement=best.fit.state,
        std_displacement=np.sqrt(variance),
        force=best.force[: len(geometry.coordinates)] * factor,
        noise=best.fit.sigma,
        left_out=~best.fit.counts,
        noise_probability=probability,
        surrogate_error=best.surrogate_error,
        geometry=geometry,
    )
