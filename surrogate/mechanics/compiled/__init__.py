"""Loops over the cells of a body that Numba compiles: forces, stresses and tangents on CPUs."""
