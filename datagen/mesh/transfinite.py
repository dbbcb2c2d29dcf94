"""Base of the geometries that are described in the case file and meshed by gmsh."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Field

from datagen.mesh.gmsh_model import gmsh_session, mesh_of
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.configuration import Frozen
from shared_schema.common.machine import require_memory

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
