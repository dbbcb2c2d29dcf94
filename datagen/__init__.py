"""Data factory: Neo-Hookean equilibria under families of nodal loads, written as datasets."""

__version__ = "0.1.0"
