"""A rectangle of quadrilaterals or a cuboid of hexahedra."""

from __future__ import annotations

import math
from typing import Any, Literal

from pydantic import Field, model_validator

from datagen.mesh.transfinite import Elements, Transfinite
from shared_schema.common.units import Length


class Box(Transfinite):
    """Rectangle of quadrilaterals, or cuboid of hexahedra, in equal elements.

    Attributes
    ----------
    kind : "box"
        Kind of the geometry.
    lower, upper : tuple of d floats
        Opposite corners in m.
    elements : tuple of d ints
        Number of elements along each axis.
    """

    kind: Literal["box"] = "box"
    lower: tuple[Length, ...] = Field(min_length=2, max_length=3)
    upper: tuple[Length, ...] = Field(min_length=2, max_length=3)
    elements: tuple[Elements, ...] = Field(min_length=2, max_length=3)

    @property
    def dimension(self) -> int:
        """Number of space dimensions d."""
        return len(self.elements)

    @model_validator(mode="after")
    def _is_box(self) -> Box:
        if not len(self.lower) == len(self.upper) == len(self.elements):
            raise ValueError("expected lower, upper and elements of the same length")
        if any(a >= b for a, b in zip(self.lower, self.upper, strict=True)):
            raise ValueError("expected every coordinate of lower below that of upper")
        self._require_resolved(self.lower, self.upper, self.elements)
        return self

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return math.prod(count + 1 for count in self.elements)

    def build(self, model: Any) -> None:
        """Draw and mesh the box in the current gmsh model."""
        nx, ny = self.elements[:2]
        geo = model.geo
        (x0, y0), (x1, y1) = self.lower[:2], self.upper[:2]
        z0 = self.lower[2] if self.dimension == 3 else 0.0
        corners = [geo.addPoint(x, y, z0) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
        sides = [geo.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        base = geo.addPlaneSurface([geo.addCurveLoop(sides)])
        for side, elements in zip(sides, (nx, ny, nx, ny), strict=True):
            geo.mesh.setTransfiniteCurve(side, elements + 1)
        geo.mesh.setTransfiniteSurface(base)
        geo.mesh.setRecombine(2, base)
        if self.dimension == 3:
            height = self.upper[2] - z0
            layers = [self.elements[2]]
            geo.extrude([(2, base)], 0, 0, height, numElements=layers, recombine=True)
        geo.synchronize()
        model.mesh.generate(self.dimension)
