"""Drawings of bodies in the plane."""

from __future__ import annotations

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.drawing.drawing import Array, Drawing
from shared_schema.common.drawing.drawn_mesh import surface_edges, surface_faces

BAND = 4.0  # width in points of a loaded edge


class PlaneDrawing(Drawing):
    """A drawing in the plane."""

    def field(self, x: Array, values: Array) -> ScalarMappable:
        """Shade the cells smoothly; a quadrilateral becomes four triangles round its centre."""
        cells = self._mesh.cells
        if self._mesh.cell_type == "quad":
            centre = len(x) + np.arange(len(cells))
            x = np.concatenate((x, x[cells].mean(axis=1)))
            values = np.concatenate((values, values[cells].mean(axis=1)))
            sides = [(cells[:, i], cells[:, (i + 1) % 4], centre) for i in range(4)]
            cells = np.concatenate([np.stack(side, axis=1) for side in sides])
        x = self._seen(x)
        triangles = Triangulation(x[:, 0], x[:, 1], cells)
        return self.axes.tripcolor(
            triangles, values, shading="gouraud", cmap="viridis", rasterized=True
        )

    def seen_nodes(self, x: Array) -> NDArray[np.int64]:
        """Return the numbers of all nodes."""
        return np.arange(len(x))

    def _edges(self, x: Array) -> list[Array]:
        return list(self._seen(x)[surface_edges(self._mesh)])

    def _outline(self) -> list[Array]:
        return self._edges(self._mesh.coordinates)

    def _shade(self, x: Array, nodes: NDArray[np.int64]) -> None:
        """Draw the loaded edges of the boundary as a wide band."""
        edges = boundary_facets(self._mesh.cells, self._mesh.cell_type)
        loaded = edges[np.isin(edges, nodes).all(axis=1)]
        band = LineCollection(list(x[loaded]), colors="black", alpha=0.4, linewidth=BAND)
        self.axes.add_collection(band)

    def _on_paper(self, x: Array) -> Array:
        return x

    def _from_the_back(self, x: Array) -> NDArray[np.int64]:
        return surface_faces(self._mesh)

    def _label_axes(self) -> None:
        unit = self.units.length
        self.axes.set(xlabel=f"x [{unit}]", ylabel=f"y [{unit}]")
