"""L-shape of quadrilaterals: a horizontal arm and a higher block at its end."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import model_validator

from datagen.mesh.transfinite import Elements, Transfinite
from shared_schema.common.configuration import Frozen
from shared_schema.common.units import Size


class Arm(Frozen):
    """Horizontal part of an L-shape.

    Attributes
    ----------
    length : float
        Length along x in m.
    elements : tuple of 2 ints
        Number of elements along x and y.
    """

    length: Size
    elements: tuple[Elements, Elements]


class Block(Frozen):
    """Upright part of an L-shape.

    Attributes
    ----------
    width, height : float
        Lengths along x and y in m.
    elements : tuple of 2 ints
        Number of elements along x and y.
    """

    width: Size
    height: Size
    elements: tuple[Elements, Elements]


class LShape(Transfinite):
    r"""Arm along x from the origin, and a higher block at its end.

    Arm and block share the nodes of the side between them, so their elements have the same height.
    The height of the arm follows from it: with n elements along y,

    .. math:: h_{arm} = h_{block} \, n_{arm} / n_{block}.

    Attributes
    ----------
    kind : "lshape"
        Kind of the geometry.
    arm : Arm
        Horizontal part.
    block : Block
        Upright part at the arm's end.
    """

    kind: Literal["lshape"] = "lshape"
    arm: Arm
    block: Block

    @property
    def dimension(self) -> int:
        """Number of space dimensions d."""
        return 2

    @model_validator(mode="after")
    def _is_lshape(self) -> LShape:
        if self.arm.elements[1] >= self.block.elements[1]:
            raise ValueError("expected fewer elements along y in the arm than in the block")
        size = self.arm.length + self.block.width, self.block.height
        elements = self.arm.elements[0] + self.block.elements[0], self.block.elements[1]
        self._require_resolved((0.0, 0.0), size, elements)
        return self

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        (arm_x, arm_y), (block_x, block_y) = self.arm.elements, self.block.elements
        return (arm_x + 1) * (arm_y + 1) + (block_x + 1) * (block_y + 1) - (arm_y + 1)

    def build(self, model: Any) -> None:
        """Draw and mesh arm and block in the current gmsh model."""
        geo = model.geo
        (arm_x, arm_y), (block_x, block_y) = self.arm.elements, self.block.elements
        step = self.block.height / block_y
        x1, x2 = self.arm.length, self.arm.length + self.block.width
        y1, y2 = arm_y * step, self.block.height
        at = [(0, 0), (x1, 0), (x1, y1), (0, y1), (x2, 0), (x2, y2), (x1, y2)]
        p = [geo.addPoint(x, y, 0) for x, y in at]

        def side(start: int, end: int, elements: int) -> int:
            line: int = geo.addLine(p[start], p[end])
            geo.mesh.setTransfiniteCurve(line, elements + 1)
            return line

        shared = side(1, 2, arm_y)
        arm = [side(0, 1, arm_x), shared, side(2, 3, arm_x), side(3, 0, arm_y)]
        block = [
            side(1, 4, block_x),
            side(4, 5, block_y),
            side(5, 6, block_x),
            side(6, 2, block_y - arm_y),
            -shared,
        ]
        for sides, corners in ((arm, (0, 1, 2, 3)), (block, (1, 4, 5, 6))):
            surface = geo.addPlaneSurface([geo.addCurveLoop(sides)])
            tags = [p[corner] for corner in corners]
            geo.mesh.setTransfiniteSurface(surface, cornerTags=tags)
            geo.mesh.setRecombine(2, surface)
        geo.synchronize()
        model.mesh.generate(2)
