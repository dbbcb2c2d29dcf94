"""Data factory: solves Neo-Hookean equilibria under families of nodal loads, writes datasets."""

__version__ = "0.2.0"
