"""Matrices of a body: tangents as bands or sparse, their factors, and solutions by iterations."""
