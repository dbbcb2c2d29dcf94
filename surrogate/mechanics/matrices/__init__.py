"""Matrices of a body: tangents as bands or sparse, and their factors."""
