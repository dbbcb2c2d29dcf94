"""Elements that a body is solved with, as far as the learner knows them.

The learner assembles linear, quadratic and `incompressible` elements. Certificates and corrections
are statements about the very equations that made the data, so they are refused for a body of other
elements, of a later version. The linear response K⁻¹f in a network's input only
has to resemble the body's: for quadratic and other elements it is that of linear elements on the
same nodes, with a Poisson's ratio of at most 0.4, for which they hardly lock; the network learns
the difference. Load series are those of the body's own elements, except in reduced networks and in
networks of earlier versions.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from shared_schema.common.errors import InputError
from shared_schema.common.units import Units
from shared_schema.materials import (
    LARGEST_RATIO,
    Material,
    Materials,
    NeoHookean,
    RubberLike,
    YoungPoisson,
    locking_warning,
    materials_of,
    ratio_at_rest,
)
from surrogate.mechanics.body.geometry import Geometry

logger = logging.getLogger(__name__)
ELEMENTS = ("linear", "quadratic", "incompressible")
SIMPLICES = ("triangle", "tetra")


def element_of(case: Mapping[str, Any]) -> str:
    """Element that a case configuration names."""
    return str(case.get("element", "linear"))


def warn_of_locking(case: Mapping[str, Any], cell_type: str) -> None:
    """Log a warning if the elements of a case, on cells of meshio's name, are too stiff."""
    try:
        materials = materials_of(case.get("material"), "case")
    except InputError:  # of a later version: nothing is known of it
        return
    if said := locking_warning(element_of(case), cell_type, materials):
        logger.warning(said)


def with_elements(geometry: Geometry, case: Mapping[str, Any], forces: str | None) -> Geometry:
    """Geometry of a body with the elements and actuators of its case, and labels of its units.

    Parameters
    ----------
    geometry : Geometry
    case : mapping
        Configuration of the case.
    forces : {"consistent"} or None
        What the manifest says of forces between the nodes; None if pressures act at corners alone.
    """
    between = has_points_between(case, geometry.cell_type)
    found = replace(
        geometry,
        mean_dilation=has_mean_dilation(case, geometry.cell_type),
        has_points_between=between,
        pressed_by_corners=between and forces is None,
        units=Units.of_case(case),
    )
    if not case.get("actuators"):
        return found
    from shared_schema.actuators import actuators_of, placed_actuators  # few bodies have some

    at = found if found.shapes is None else replace(found, coordinates=found.shapes.terms[0])
    placed = placed_actuators(actuators_of(case["actuators"]), at.loaded_body)
    return replace(found, actuators=placed if at is found else placed.on(found.positions))


def has_mean_dilation(case: Mapping[str, Any], cell_type: str) -> bool:
    """Whether the volumes of a case's cells change as a whole."""
    return element_of(case) == "incompressible" and cell_type in ("quad", "hexahedron")


def has_points_between(case: Mapping[str, Any], cell_type: str) -> bool:
    """Whether the elements of a case have displacements between the nodes of the mesh."""
    element = element_of(case)
    return element == "quadratic" or (element == "incompressible" and cell_type in SIMPLICES)


def with_dilations(geometry: Geometry, case: Mapping[str, Any]) -> Geometry:
    """Geometry of the elements themselves, whose dilations may be between the nodes as well."""
    return replace(geometry, mean_dilation=element_of(case) == "incompressible")


def loads_of_before(geometry: Geometry) -> str | None:
    """Say that the loads of a dataset act at corners alone, as in earlier versions; else None."""
    if not geometry.pressed_by_corners:
        return None
    return (
        "of an earlier version, whose distributed loads and pressures act at the corners of the "
        "elements alone; new loads act between the corners too"
    )


def require_known_elements(case: Mapping[str, Any]) -> None:
    """Raise InputError unless the learner computes the equilibria of a case's elements."""
    element = element_of(case)
    if element not in ELEMENTS:
        raise InputError(
            f"key 'element' of the run's case = '{element}': certificates, corrections and "
            f"stresses are for {', '.join(ELEMENTS)} elements; `datagen solve` has those of others"
        )


def body_of_response(
    geometry: Geometry, material: Materials, case: Mapping[str, Any], series: bool
) -> tuple[Geometry, Materials]:
    """Geometry and material of the linear response in a network's input, under dead loads.

    Parameters
    ----------
    geometry : Geometry
        From `with_elements`.
    material : Material, or tuple of some
    case : mapping
        Configuration of the case.
    series : bool
        Whether the network goes on from the response by a load series of linear elements.
    """
    if series:
        geometry = replace(geometry, pressed=None, pressed_surface=None, has_points_between=False)
    if element_of(case) == "linear" or (geometry.mean_dilation and not series):
        return geometry, material
    linear = replace(geometry, mean_dilation=False)
    if isinstance(material, tuple):
        return linear, tuple(_compressible(each) for each in material)
    return linear, _compressible(material)


def _compressible(material: Material) -> Material:
    """Material of the same shear modulus (of Young's, where named), with a ratio of at most 0.4.

    A user's own energy, whose moduli have no names, becomes Neo-Hookean.
    """
    if ratio_at_rest(material) <= LARGEST_RATIO:
        return material
    if isinstance(material, RubberLike):
        bulk = 2 * (1 + LARGEST_RATIO) / (3 * (1 - 2 * LARGEST_RATIO)) * material.lame_mu
        return material.model_copy(update={"bulk_modulus": bulk})
    if isinstance(material, YoungPoisson):
        return material.model_copy(update={"poisson_ratio": LARGEST_RATIO})
    young = 2 * (1 + LARGEST_RATIO) * material.lame_mu
    return NeoHookean(young_modulus=young, poisson_ratio=LARGEST_RATIO, group=material.group)
