r"""Kinds of elements: degrees of displacement and dilation, and quadrature.

================  ==================  ==========================  ==========================
element           cells               displacement                dilation :math:`θ`
================  ==================  ==========================  ==========================
linear            all                 linear (P1, Q1)             J itself
quadratic         all                 quadratic (P2, Q2)          J itself
incompressible    quads, hexahedra    linear (Q1)                 constant in each cell
incompressible    triangles,          quadratic (P2)              linear, continuous (P1)
                  tetrahedra
================  ==================  ==========================  ==========================

Elements of low order lock where the volume hardly changes (Poisson's ratio near 1/2): J = det F is
then prescribed at more points than there are displacements to choose. In an `incompressible`
element the volume is free to change at single points, and only its dilation θ, a function of fewer
parameters, enters the energy:

.. math::
    Π(u, θ, p) = \int_Ω W(\bar F) + p (J - θ) \, dV, \qquad \bar F = (θ/J)^{1/d} F,

with the pressure p of the same space as θ (Simo, Taylor and Pister 1985). Stationarity says that θ
is the projection of J, and :math:`-p` that of :math:`∂W/∂θ`. On quadrilaterals and hexahedra, θ and
p are constant in each cell and eliminated there (*F-bar*, or *mean dilatation*): θ is the mean of
J. On triangles and tetrahedra they are linear and continuous (the pair of Taylor and Hood), and
stay unknowns beside the displacement. The energy density W is that of any material.

Meshes have straight edges; nodes of quadratic elements are the corners of the cells, the midpoints
of edges, and on quadrilaterals and hexahedra the centres of faces and cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

Element = Literal["linear", "quadratic", "incompressible"]
ELEMENTS: tuple[Element, ...] = get_args(Element)
SIMPLICES = ("triangle", "tetra")


@dataclass(frozen=True)
class ElementKind:
    """An element on cells of one type.

    Attributes
    ----------
    degree : int
        Polynomial degree of the displacement: 1 or 2.
    dilation : {"pointwise", "cell", "continuous"}
        Space of θ: J at each point, a constant in each cell, or linear and continuous.
    quadrature_degree : int
        Polynomials of this degree are integrated exactly: 2 Gauss points along each axis of
        linear quadrilaterals and hexahedra, 3 of quadratic ones; 3 points in a triangle, 4 in a
        tetrahedron.
    """

    degree: int
    dilation: Literal["pointwise", "cell", "continuous"]
    quadrature_degree: int

    @property
    def has_pressure(self) -> bool:
        """True if dilation and pressure are unknowns beside the displacement."""
        return self.dilation == "continuous"

    @property
    def corners_only(self) -> bool:
        """True if the displacements of the cells' corners are the only unknowns."""
        return self.degree == 1


def element_kind(element: Element, cell_type: str) -> ElementKind:
    """Kind of the elements that a case names, on cells of a type (meshio's name)."""
    simplices = cell_type in SIMPLICES
    if element == "linear":
        return ElementKind(1, "pointwise", 2)
    if element == "incompressible" and not simplices:
        return ElementKind(1, "cell", 2)
    dilation: Literal["pointwise", "continuous"]
    dilation = "pointwise" if element == "quadratic" else "continuous"
    return ElementKind(2, dilation, 2 if simplices else 4)
