"""Quadratic elements: their reference cells, and the points between the nodes of a mesh."""
