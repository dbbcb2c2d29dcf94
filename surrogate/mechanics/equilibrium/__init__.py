"""Equilibria of a body: out-of-balance forces, Newton's steps, K⁻¹, stresses, reactions."""
