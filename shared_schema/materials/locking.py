r"""How much too stiff linear elements are where the volume hardly changes: they lock.

That is known of a beam of 100 × 20 × 16 mm (in the plane 100 × 16 mm) that is held at one end and
bent by a traction at the other, with 4 cells across its thickness: the fraction by which the
deflection of its end falls short of that with `incompressible` elements on a mesh twice as fine
(`docs/benchmarks/elements.md`). Between the measured ratios of Poisson they are interpolated in
:math:`\log(1 - 2ν)`.
"""

from __future__ import annotations

import numpy as np

from shared_schema.materials.reading import Materials, as_tuple, ratio_at_rest

LARGEST_RATIO = 0.4  # of Poisson, up to which linear elements are used without a word
RATIOS = (0.4, 0.45, 0.49, 0.499)
SHORTFALL = {
    "triangle": (0.23, 0.34, 0.68, 0.93),
    "quad": (0.07, 0.13, 0.44, 0.87),
    "tetra": (0.25, 0.36, 0.68, 0.93),
    "hexahedron": (0.05, 0.08, 0.20, 0.44),
}


def locks(materials: Materials) -> bool:
    """Whether linear elements lock: Poisson's ratio of a material is above 0.4."""
    return largest_ratio(materials) > LARGEST_RATIO


def locking_warning(element: str, cell_type: str, materials: Materials) -> str | None:
    """Say by how much the elements of a body are too stiff, if they are linear and lock.

    Parameters
    ----------
    element : {"linear", "quadratic", "incompressible"}
    cell_type : str
        Meshio's name.
    materials : Material or tuple of some
    """
    if element != "linear" or (ratio := largest_ratio(materials)) <= LARGEST_RATIO:
        return None
    return (
        f"linear elements are too stiff for a Poisson's ratio of {ratio:g}: a beam of 4 "
        f"{cell_type} cells across bends {shortfall(cell_type, ratio):.0%} too little; "
        "expected 'element: incompressible', or 'quadratic'"
    )


def largest_ratio(materials: Materials) -> float:
    """Largest Poisson's ratio at rest."""
    return max(ratio_at_rest(material) for material in as_tuple(materials))


def shortfall(cell_type: str, poisson_ratio: float) -> float:
    """Fraction by which linear elements bend too little."""
    at = -np.log(1 - 2 * np.array(poisson_ratio))
    known = -np.log(1 - 2 * np.array(RATIOS))
    return float(np.interp(at, known, SHORTFALL[cell_type]))
