"""Strain energies as lists of scalar operations."""
