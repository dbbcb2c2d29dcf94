"""An L-shape of quadrilaterals: a horizontal arm and a higher block at its end."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, model_validator

from datagen.mesh.transfinite import PositiveInt, Transfinite
from shared_schema.common.configuration import Frozen


class Arm(Frozen):
    """The horizontal part of an L-shape.

    Attributes
    ----------
    length : float
        In m.
    elements : tuple of 2 ints
        Along x and y.
    """

    length: float = Field(gt=0)
    elements: tuple[PositiveInt, PositiveInt]


class Block(Frozen):
    """The upright part of an L-shape.

    Attributes
    ----------
    width, height : float
        In m.
    elements : tuple of 2 ints
        Along x and y.
    """

    width: float = Field(gt=0)
    height: float = Field(gt=0)
    elements: tuple[PositiveInt, PositiveInt]


class LShape(Transfinite):
    """An arm along x from the origin, and a higher block at its end, which share a side's nodes.

    The elements of arm and block are of the same height, so the arm is as high as its number of
    elements along y says.

    Attributes
    ----------
    kind : "lshape"
    arm : Arm
    block : Block
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
        return self

    def build(self, model: Any) -> None:
        """Draw and mesh the two blocks in the current gmsh model."""
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
