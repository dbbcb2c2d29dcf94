"""Geometries and mesh files as arrays, distributed meshes, regions of nodes."""
