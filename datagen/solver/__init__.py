"""Equilibrium of a Neo-Hookean solid: material, assembly, linear solver, load stepping."""
