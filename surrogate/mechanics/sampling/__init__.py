"""Samples of a body without finite-element software: drawn, predicted, driven to equilibrium."""
