r"""What is sought: forces at known places, pressures, and Young's modulus.

The load is that of some parameters θ, dead forces f, and pressures or tensions p that follow the
body,

.. math::
    f(θ) = \frac{E_0}{E} \Big(f_0 + \sum_k θ_k \, b_k\Big), \qquad
    p(θ) = \frac{E_0}{E} \Big(p_0 + \sum_q θ_q \, e_q\Big), \qquad E = E_0 \, e^{φ},

with known forces :math:`f_0` and pressures :math:`p_0`, unit forces :math:`b_k` along each axis at
each sought place, unit pressures and tensions :math:`e_q`, and Young's modulus :math:`E_0` of the
run. Without a sought modulus φ = 0. Sought moduli of zones of the body,
:math:`E_z = E_{z,0} \, e^{φ_z}`, leave f and p as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.common.bodies.equilibrium import mean_edge
from shared_schema.common.bodies.following_loads import FollowingLoad, PressedSurface
from shared_schema.common.errors import InputError
from shared_schema.tools import Tool
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.statics.load import Load, given_load

Array = NDArray[np.float64]

BODY_FORCE = "body-force"
YOUNG_MODULUS = "young-modulus"
SOMEWHERE = "somewhere"
ANY = "any"
LARGEST_PATCH = 0.25  # of the body's length: radius of a force whose radius is sought
TOOL = "tool"
PRESSURE = "pressure:"  # of a group
ACTUATOR = "actuator:"
FOLLOWING = (PRESSURE, ACTUATOR)
AXES = "xyz"
OF_ZONE = f"{YOUNG_MODULUS}:"


@dataclass(frozen=True)
class Unknowns:
    """Sought parameters.

    Attributes
    ----------
    names : tuple of str
        Of each parameter, such as "4,1 x"; those of φ are last.
    known : array, (n_nodes or n_points, d)
        f₀ in N, with what acts between the nodes after the nodal forces.
    patterns : array, (K, n_nodes or n_points, d)
        b_k: 1 N in all, or those of 1 N/m³.
    following : FollowingLoads or None
        Amplitudes of 1 + Q cases: p₀, and each e_q of 1 Pa or N. None if none acts.
    moduli : array, (q,)
        E₀ in Pa of every φ that is sought.
    zones : tuple of str
        Groups of the materials that they belong to; empty if they are those of the whole body.
    tool : Tool or None
        A tool whose place is sought: θ is how far it is from there, in m.
    """

    names: tuple[str, ...]
    known: Array
    patterns: Array
    moduli: Array
    zones: tuple[str, ...] = ()
    tool: Tool | None = None
    following: FollowingLoads | None = None

    @classmethod
    def of(
        cls,
        geometry: Geometry,
        texts: Sequence[str],
        known: CommandLoads,
        moduli: Array,
        nearest: bool = False,
        tool: Tool | None = None,
    ) -> Unknowns:
        """Read what is sought.

        Parameters
        ----------
        geometry : Geometry
        texts : sequence of str
            Places as loads name them ("4,1", "4,1,0.2" or a group), "body-force",
            "pressure:GROUP", "actuator:NAME", "young-modulus", or "young-modulus:GROUP" of zones,
            and "somewhere" (`radii_of`), which `at` brings in.
        known : CommandLoads
        moduli : array, (q,)
        nearest : bool
            Let places beside a node mean the nearest one.
        tool : Tool, optional
            What "tool" means, which is then sought alone.

        Raises
        ------
        InputError
            If there is no such place, or one is named twice, if a pressure of the case acts where a
            force is sought, or the network knows no pressure, or the tool is not what is sought.
        """
        if (tool is not None) != (list(texts) == [TOOL]):
            raise InputError(f"unknown: {', '.join(texts)}: expected 'tool' alone, and a tool")
        if tool is not None:
            names = tuple(f"{TOOL} {axis}" for axis in AXES[: geometry.dimension])
            none = np.empty((0, *known.load.shape))
            of_load = FollowingLoads.of_load(known)
            return cls(names, known.load, none, np.empty(0), tool=tool, following=of_load)
        if len(set(texts)) < len(texts):
            raise InputError(f"unknown: {', '.join(texts)}: expected each once")
        sought: list[str] = []
        patterns: list[Array] = []
        for text in texts:
            if is_somewhere(text) or is_modulus(text) or text.startswith(FOLLOWING):
                continue
            require_no_pressure(geometry, text)
            for axis, unit in enumerate(np.eye(geometry.dimension)):
                load, values = CommandLoads(geometry.loaded_body), ",".join(map(str, unit))
                if text == BODY_FORCE:
                    load.add_body_force(values)
                else:
                    load.add(f"{text}:{values}", nearest)
                sought.append(f"{text} {AXES[axis]}")
                patterns.append(load.load)
        zones, following = zones_of(texts), followers_of(geometry, texts, known)
        if YOUNG_MODULUS in texts and not (known.load.any() or known.surfaces):
            raise InputError(
                "unknown: young-modulus: displacements tell forces over Young's modulus alone, "
                "expected a load that is known beside it"
            )
        sought += [text for text in texts if text.startswith(FOLLOWING)]
        sought += [text for text in texts if is_modulus(text)]
        if not sought and not any(map(is_somewhere, texts)):
            raise InputError("unknown: nothing is sought, expected a place or young-modulus")
        shape = (len(patterns), *known.load.shape)
        stacked = np.array(patterns).reshape(shape)
        return cls(tuple(sought), known.load, stacked, moduli, zones, following=following)

    @property
    def softens(self) -> bool:
        """Whether φ is that of the whole body."""
        return len(self.moduli) > len(self.zones)

    def young_moduli(self, theta: Array) -> Array:
        """Sought moduli in Pa, (q,); infinite beyond all numbers."""
        with np.errstate(over="ignore"):
            return np.asarray(self.moduli * np.exp(theta[len(theta) - len(self.moduli) :]))

    def load(self, theta: Array) -> Load:
        """f(θ) and p(θ) of N sets of parameters, (N, p), or of one, for a body of E₀."""
        count = len(self.patterns)
        dead = self.known + np.tensordot(theta[..., :count], self.patterns, axes=1)
        factor = np.exp(-theta[..., -1:]) if self.softens else np.ones(1)
        load = Load(dead * factor[..., None])
        if self.following is None:
            return load
        values = self.following.amplitudes
        sought = np.atleast_2d(theta)[:, count : count + len(values) - 1]
        pressures = (values[0] + sought @ values[1:]) * factor
        return replace(load, following=replace(self.following, amplitudes=pressures))

    @property
    def at_rest(self) -> tuple[Array, Array]:
        """Known and unit loads on the undeformed body, (*, d) and (K + Q, *, d)."""
        if self.following is None:
            return self.known, self.patterns
        loads = self.following.load
        return self.known + loads[0], np.concatenate([self.patterns, loads[1:]])

    def at(self, units: Array, text: str) -> Unknowns:
        """The same with forces in one more place, which come first.

        Parameters
        ----------
        units : array, (d, n_nodes or n_points, d)
            Those of 1 N along each axis.
        text : str
            Name of the place.
        """
        names = tuple(f"{text} {axis}" for axis in AXES[: len(units)])
        patterns = np.concatenate([units, self.patterns])
        return replace(self, names=names + self.names, patterns=patterns)


def is_modulus(text: str) -> bool:
    """Whether Young's modulus is sought, of the body or a zone."""
    return text == YOUNG_MODULUS or text.startswith(OF_ZONE)


def zones_of(texts: Sequence[str]) -> tuple[str, ...]:
    """Zones whose moduli are sought."""
    return tuple(text.removeprefix(OF_ZONE) for text in texts if text.startswith(OF_ZONE))


def followers_of(
    geometry: Geometry, texts: Sequence[str], known: CommandLoads
) -> FollowingLoads | None:
    """Known pressures, and each sought pressure or tension of 1 Pa or N, as load cases.

    None if there are none.
    """
    units: list[FollowingLoad] = [PressedSurface(facets) for facets in known.surfaces]
    units += [unit_of(geometry, text) for text in texts if text.startswith(FOLLOWING)]
    if not units:
        return None
    count = len(known.pressures)
    values = np.eye(1 + len(units) - count, len(units), count - 1)
    values[0] = [*known.pressures, *np.zeros(len(units) - count)]
    body = geometry.loaded_body
    return FollowingLoads.on(body.coordinates, units, values, body.points)


def unit_of(geometry: Geometry, text: str) -> FollowingLoad:
    """A sought pressure or tension of 1 Pa or N; InputError if there is no such thing."""
    name = text.partition(":")[2]
    placed = geometry.actuators
    if text.startswith(ACTUATOR):
        names = () if placed is None else placed.names
        if placed is None or name not in names:
            known = ", ".join(names) or "none"
            raise InputError(
                f"unknown: {text}: expected an actuator of the case, which has {known}"
            )
        return placed.loads[names.index(name)]
    if name not in geometry.groups:
        known = ", ".join(sorted(geometry.groups)) or "none"
        raise InputError(f"unknown: {text}: expected a group of the mesh, which has {known}")
    (facets,) = given_load(geometry, [f"{name}:1"], needed=False).surfaces
    return PressedSurface(facets)


def is_somewhere(text: str) -> bool:
    """Whether a force is sought somewhere on the surface."""
    return text.partition(",")[0] == SOMEWHERE


def radii_of(geometry: Geometry, text: str) -> list[float]:
    """Radii in m that the force may be spread over which acts somewhere; 0 on a node alone.

    Parameters
    ----------
    geometry : Geometry
    text : str
        "somewhere" on a node, "somewhere,R" within R m of one, "somewhere,any" of a radius that is
        sought: none, the length of an edge, √2 times, twice and so on, up to a quarter of the
        body's length.

    Raises
    ------
    InputError
        If the radius is none.
    """
    _, comma, said = text.partition(",")
    if not comma:
        return [0.0]
    if said == ANY:
        edge = mean_edge(geometry.coordinates, geometry.cells)
        longest = LARGEST_PATCH * float(np.ptp(geometry.coordinates, axis=0).max())
        steps = max(int(2 * np.log2(longest / edge)), 0)
        return [0.0, *(edge * 2.0 ** (k / 2) for k in range(steps + 1))]
    try:
        radius = float(said)
    except ValueError:
        radius = 0.0
    if not 0 < radius < np.inf:
        raise InputError(
            f"unknown: {text}: expected {SOMEWHERE},R with R > 0 m, or {SOMEWHERE},any"
        )
    return [radius]


def require_no_pressure(geometry: Geometry, text: str) -> None:
    """Raise InputError if a pressure of the case acts on a group, which no total force stands for.

    A pressure that follows the surface turns with it, and the forces of a closed surface add up to
    none.
    """
    if text not in geometry.groups:
        return
    facets = np.sort(geometry.loaded_body.facets_of(text), axis=1)
    corners = facets.shape[1]  # which stand before the other points of a facet
    names = [f"{PRESSURE}{text}"] * len(geometry.surfaces)
    if geometry.actuators is not None:
        names += [f"{ACTUATOR}{name}" for name in geometry.actuators.names]
    for name, unit in zip(names, geometry.following, strict=True):
        surface = unit.facets if isinstance(unit, PressedSurface) else facets[:0]
        pressed = {tuple(sorted(row[:corners])) for row in surface}
        if any(tuple(row) in pressed for row in facets):
            raise InputError(f"unknown: {text}: a pressure acts there, expected {name}")
