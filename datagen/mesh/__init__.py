"""Meshes: geometries, mesh files, distributed meshes, node numbers, regions of nodes."""
