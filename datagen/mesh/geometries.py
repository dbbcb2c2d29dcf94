"""The geometries that a case file can name: boxes, L-shapes, and mesh files.

The key ``kind`` of its ``mesh`` tells them apart. gmsh meshes those that the case describes.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from datagen.mesh.gmsh_model import gmsh_session, mesh_of
from datagen.mesh.mesh_file import MeshFile
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.configuration import Frozen
from shared_schema.common.machine import require_memory
from shared_schema.common.units import Length, Size

Elements = Annotated[int, Field(gt=0, le=10**6)]  # along an axis
BYTES_PER_NODE = {2: 4000, 3: 15000}  # of mesh and problem, measured; LU factors come on top
FINEST = 1e-9  # smallest element, over the largest coordinate of the body


class Transfinite(Frozen):
    """A geometry that gmsh meshes by transfinite curves and surfaces; lengths are in m."""

    def _require_resolved(
        self, lower: Sequence[float], upper: Sequence[float], elements: Sequence[int]
    ) -> None:
        """Raise ValueError if elements are too small for the rounding of coordinates."""
        largest = max(abs(value) for value in (*lower, *upper))
        smallest = min((b - a) / n for a, b, n in zip(lower, upper, elements, strict=True))
        if smallest < FINEST * largest:
            raise ValueError(
                f"the smallest element is {smallest:.3g} m long, expected at least {FINEST:g} of "
                f"the largest coordinate, {largest:.3g} m"
            )

    @abstractmethod
    def build(self, model: Any) -> None:
        """Draw and mesh the geometry in the current gmsh model."""

    @property
    @abstractmethod
    def dimension(self) -> int:
        """Number of space dimensions d."""

    @property
    @abstractmethod
    def nodes(self) -> int:
        """Number of nodes."""

    def raw_mesh(self) -> RawMesh:
        """Generate the mesh with gmsh.

        Raises
        ------
        InputError
            If mesh and problem need more memory than there is.
        """
        needed = BYTES_PER_NODE[self.dimension] * self.nodes
        require_memory(needed, f"key 'mesh': a mesh of {self.nodes} nodes")
        with gmsh_session() as gmsh:
            self.build(gmsh.model)
            return mesh_of(gmsh.model)


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


Geometry = Annotated[Box | LShape | MeshFile, Field(discriminator="kind")]
