"""Strain energies and their derivatives as lists of scalar operations."""
